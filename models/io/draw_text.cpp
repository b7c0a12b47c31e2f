// See draw_text.h.
#include "models/io/draw_text.h"

#include <OpenImageIO/imagebuf.h>
#include <OpenImageIO/imagebufalgo.h>

namespace cloam {
namespace {

constexpr char kFont[] = "DejaVuSans";

OIIO::ROI extent(const std::string& line, int height) {
  const OIIO::ROI found = OIIO::ImageBufAlgo::text_size(line, height, kFont);
  OIIO::geterror();  // else it is printed at the program's end
  return found;
}

}  // namespace

bool can_draw_text() {
  static const bool has_font = extent("cloam", 12).defined();
  return has_font;
}

int text_width(const std::string& line, int height) {
  const OIIO::ROI found = extent(line, height);
  return found.defined() ? found.width() : 0;
}

void draw_text(Image& image, const std::string& line, int left, int baseline, int height) {
  if (!can_draw_text()) return;
  OIIO::ImageBuf pixels(OIIO::ImageSpec(image.width, image.height, 3, OIIO::TypeDesc::UINT8), image.pixels.data());
  const float black[] = {0, 0, 0};
  OIIO::ImageBufAlgo::render_text(pixels, left, baseline, line, height, kFont, black);
}

}  // namespace cloam
