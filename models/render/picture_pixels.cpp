// See picture_pixels.h.
#include "models/render/picture_pixels.h"

#include <algorithm>

namespace cloam {

void append_pixels(Picture& picture, const std::vector<float>& values, const PixelForm& form) {
  for (size_t i = 0; i + form.numbers <= values.size(); i += form.numbers) {
    const float opacity = values[i + 3];
    for (size_t c = 0; c < 3; c++)
      picture.rgb.push_back(std::clamp(values[i + c] + form.back * (1.f - opacity), 0.f, 1.f));
    picture.opacity.push_back(opacity);
    picture.depth.push_back(opacity > 1e-3f ? values[i + 4] / opacity / static_cast<float>(form.scale) : 0.f);
  }
}

Picture halved(const Picture& picture) {
  Picture out;
  out.width = picture.width / 2;
  out.height = picture.height / 2;
  for (int y = 0; y < out.height; y++)
    for (int x = 0; x < out.width; x++) {
      float rgb[3] = {}, opacity = 0, depth = 0;
      for (int k = 0; k < 4; k++) {
        const auto at = static_cast<size_t>((2 * y + k / 2) * picture.width + 2 * x + k % 2);
        for (size_t c = 0; c < 3; c++) rgb[c] += picture.rgb[3 * at + c] / 4;
        opacity += picture.opacity[at] / 4;
        depth += picture.opacity[at] * picture.depth[at] / 4;
      }
      out.rgb.insert(out.rgb.end(), rgb, rgb + 3);
      out.opacity.push_back(opacity);
      out.depth.push_back(opacity > 1e-3f ? depth / opacity : 0.f);
    }
  return out;
}

}  // namespace cloam
