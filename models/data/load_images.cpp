// See load_images.h. One image at a time is held at full size.
#include "models/data/load_images.h"

#include <algorithm>
#include <cmath>

#include "models/data/reader.h"
#include "models/io/image.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kMaskThreshold = 128;
constexpr double kSameAspect = 0.01;

// Used pixels of the result stand for used pixels alone.
std::vector<std::uint8_t> as_mask(const Image& image, int factor) {
  const int width = image.width / factor, height = image.height / factor;
  std::vector<std::uint8_t> mask(std::size_t(width) * height, 255);
  for (int row = 0; row < height * factor; ++row) {
    for (int column = 0; column < width * factor; ++column) {
      const auto value = image.pixels[(std::size_t(row) * image.width + column) * image.channels];
      if (value < kMaskThreshold) mask[std::size_t(row / factor) * width + column / factor] = 0;
    }
  }
  return mask;
}

// The lowest rows are ignored, too: they show the recording car.
void ignore_ego(FramePixels& pixels, double ego_rows, int full_height, int factor) {
  const int first = static_cast<int>(std::floor((1 - ego_rows) * full_height)) / factor;
  if (pixels.mask.empty()) pixels.mask.assign(std::size_t(pixels.width) * pixels.height, 255);
  std::fill(pixels.mask.begin() + std::ptrdiff_t(first) * pixels.width, pixels.mask.end(), std::uint8_t{0});
}

Image without_background(const Image& image, const Image& mask) {
  Image result{image.width, image.height, 4, as_rgba(image)};
  for (std::size_t i = 0; i < result.pixels.size() / 4; ++i) {
    if (mask.pixels[i * mask.channels] < kMaskThreshold) result.pixels[4 * i + 3] = 0;
  }
  return result;
}

bool has_aspect(const Camera& camera, int width, int height) {
  return std::abs(double(width) * camera.height / (double(height) * camera.width) - 1) <= kSameAspect;
}

// Poses belong to the pixels as stored, unless the size says otherwise: COLMAP ignores EXIF, phones do not.
bool must_turn(const Camera& camera, const Image& image) {
  const bool on_its_side = image.orientation >= 5;
  return on_its_side && !has_aspect(camera, image.width, image.height) && has_aspect(camera, image.height, image.width);
}

// What befell several images, told once.
struct Remark {
  int images = 0;
  std::string first;

  void add(const std::string& image) {
    if (images++ == 0) first = image;
  }
};

class Loader {
 public:
  Loader(const Scene& scene, const LoadOptions& options) : scene_(scene), options_(options) {}

  void load(std::size_t index) {
    const Frame& frame = scene_.frames[index];
    FramePixels result;
    result.frame = index;
    Image full = read_image(scene_.root / frame.image);
    const int turn = turn_of(frame, full);
    full = upright(full, turn);
    const Camera camera = fitted(scene_.cameras[frame.camera], frame, full);
    if (frame.mask) {
      const Image mask = read_mask(frame, full, turn);
      if (options_.masks == MaskMeaning::ignore) result.mask = as_mask(mask, options_.downscale);
      if (options_.masks == MaskMeaning::transparent) full = without_background(full, mask);
    }
    const int full_height = full.height;
    Image image = options_.downscale == 1 ? std::move(full) : downscale(full, options_.downscale);
    result.width = image.width;
    result.height = image.height;
    if (frame.ego_rows > 0) ignore_ego(result, frame.ego_rows, full_height, options_.downscale);
    result.rgba = image.channels == 4 ? std::move(image.pixels) : as_rgba(image);
    result.camera = find_or_add(pixels_.cameras, scaled(camera, options_.downscale));
    for (std::size_t i = 3; i < result.rgba.size() && !pixels_.has_alpha; i += 4)
      pixels_.has_alpha = result.rgba[i] < 255;
    pixels_.frames.push_back(std::move(result));
  }

  Pixels load(Split split) {
    for (const std::size_t index : frames_of(scene_, split)) {
      guarded(options_.skip_bad, pixels_.warnings, "frame dropped", [&] { load(index); });
    }
    warn(resized_, "do not have the size that the data set lists", "their intrinsics are scaled");
    warn(turned_, "are rotated as their EXIF orientation says", "the data set lists the rotated size");
    warn(left_, "have an EXIF orientation that is ignored", "the listed size is that of the stored image");
    return std::move(pixels_);
  }

 private:
  void warn(const Remark& remark, const char* what, const char* why) {
    if (remark.images == 0) return;
    pixels_.warnings.push_back(text(remark.images, " images (", remark.first, ", ...) ", what, ": ", why));
  }

  /// The EXIF orientation to follow; 1: as stored.
  int turn_of(const Frame& frame, const Image& image) {
    const bool turn = must_turn(scene_.cameras[frame.camera], image);
    if (turn) turned_.add(frame.image);
    if (!turn && image.orientation != 1) left_.add(frame.image);
    return turn ? image.orientation : 1;
  }

  Camera fitted(const Camera& camera, const Frame& frame, const Image& image) {
    if (camera.width == image.width && camera.height == image.height) return camera;
    const std::string sizes = text(frame.image, ": ", image.width, "x", image.height, " pixels, listed as ",
                                   camera.width, "x", camera.height);
    if (!has_aspect(camera, image.width, image.height))
      bad_data(sizes,
               ": the aspect ratio differs, so the intrinsics cannot be scaled to it; correct w and h "
               "there, or give the images that it was made for");
    resized_.add(sizes);
    return resized(camera, image.width, image.height);
  }

  Image read_mask(const Frame& frame, const Image& image, int turn) const {
    Image mask = read_image(scene_.root / *frame.mask);
    if (mask.width != image.width || mask.height != image.height) mask = upright(mask, turn);  // drawn as stored
    if (mask.width == image.width && mask.height == image.height) return mask;
    bad_data(*frame.mask, ": the mask has ", mask.width, "x", mask.height, " pixels, but its image ", frame.image,
             " has ", image.width, "x", image.height);
  }

  const Scene& scene_;
  LoadOptions options_;
  Pixels pixels_;
  Remark resized_, turned_, left_;
};

}  // namespace

Pixels load_images(const Scene& scene, Split split, const LoadOptions& options) {
  if (options.downscale < 1) throw Error(Fault::usage, text("--downscale ", options.downscale, ": want 1 or more"));
  return Loader(scene, options).load(split);
}

}  // namespace cloam
