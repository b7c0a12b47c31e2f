// See photo_file.h. OpenImageIO keeps what it knows of EXIF from reading to writing, and so do copies.
#include "models/io/photo_file.h"

#include <OpenImageIO/imagebuf.h>
#include <OpenImageIO/imageio.h>

#include <vector>

#include "models/io/commit.h"
#include "models/io/image.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMostPixels = std::int64_t{1} << 27;

std::string lens_of(const OIIO::ImageSpec& spec) {
  std::string lens;
  for (const char* key : {"Make", "Model", "Exif:FocalLength", "Exif:FocalLengthIn35mmFilm"})
    if (const OIIO::ParamValue* value = spec.find_attribute(key)) lens += text(key, " ", value->get_string(), "; ");
  return lens;
}

/// libheif turns what it decodes; the EXIF beside it still says how.
void forget_turn(OIIO::ImageSpec& spec) { spec.erase_attribute("Orientation"); }

OIIO::ImageSpec heic_spec(const fs::path& path) {
  const auto input = OIIO::ImageInput::create("heif");
  OIIO::ImageSpec spec;
  if (!input)
    bad_data(path.string(), ": is HEIC, which this OpenImageIO was built without\n  fix: mogrify -format jpg *.heic (",
             "ImageMagick)");
  if (!input->open(path.string(), spec))
    bad_data(path.string(), ": damaged photo: ", input->geterror(), "; copy it again");
  if (spec.width < 1 || spec.height < 1 || std::int64_t{spec.width} * spec.height > kMostPixels)
    bad_data(path.string(), ": the header says ", spec.width, "x", spec.height, " pixels; the limit is ", kMostPixels);
  forget_turn(spec);
  return spec;
}

}  // namespace

PhotoHeader read_photo_header(const fs::path& path, bool is_heic) {
  if (is_heic) {
    const OIIO::ImageSpec spec = heic_spec(path);
    return {spec.width, spec.height, true, lens_of(spec)};
  }
  const ImageSize size = read_image_size(path);
  const auto input = OIIO::ImageInput::open(path.string());
  const bool on_its_side = size.orientation >= 5;
  return {on_its_side ? size.height : size.width, on_its_side ? size.width : size.height, size.orientation == 1,
          input ? lens_of(input->spec()) : ""};
}

void write_upright(const fs::path& from, bool is_heic, const fs::path& to) {
  read_photo_header(from, is_heic);  // its sizes are sound before they are decoded
  OIIO::ImageBuf photo(from.string());
  if (!photo.read(0, 0, true, OIIO::TypeDesc::UINT8))
    bad_data(from.string(), ": damaged image: ", photo.geterror(), "; copy it again");
  OIIO::ImageSpec spec = photo.spec();
  if (is_heic) forget_turn(spec);
  Image stored{spec.width, spec.height, spec.nchannels, std::vector<std::uint8_t>(spec.image_bytes())};
  photo.get_pixels(photo.roi(), OIIO::TypeDesc::UINT8, stored.pixels.data());
  // OpenImageIO 2.4's own reorient() takes orientations 5 and 7 for each other.
  Image turned = upright(stored, spec.get_int_attribute("Orientation", 1));
  spec.width = spec.full_width = turned.width;
  spec.height = spec.full_height = turned.height;
  spec.attribute("Orientation", 1);
  spec.attribute("Compression", text("jpeg:", kJpegQuality));
  spec.attribute("jpeg:subsampling", "4:4:4");
  const OIIO::ImageBuf out(spec, turned.pixels.data());
  commit_file(to, [&](const fs::path& temp) {
    if (!out.write(temp.string(), OIIO::TypeDesc::UINT8))
      throw Error(Fault::write, text(to.string(), ": ", out.geterror(), "; ", space_advice(to.parent_path())));
  });
}

}  // namespace cloam
