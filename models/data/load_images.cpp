// See load_images.h. One image at a time is held at full size.
#include "models/data/load_images.h"

#include <algorithm>
#include <cmath>

#include "models/data/paths.h"
#include "models/io/image.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kMaskThreshold = 128;

// Black means ignore (nerfstudio). Used pixels of the result stand for used pixels alone.
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

class Loader {
 public:
  Loader(const Scene& scene, const LoadOptions& options) : scene_(scene), options_(options) {}

  void load(std::size_t index) {
    const Frame& frame = scene_.frames[index];
    FramePixels result;
    result.frame = index;
    const Image full = read_image(resolve_inside(scene_.root, frame.image));
    const Camera camera = fitted(scene_.cameras[frame.camera], frame, full);
    if (frame.mask) result.mask = read_mask(frame, full);
    const Image image = downscale(full, options_.downscale);
    result.width = image.width;
    result.height = image.height;
    result.rgba = as_rgba(image);
    result.camera = find_or_add(pixels_.cameras, scaled(camera, options_.downscale));
    for (std::size_t i = 3; i < result.rgba.size() && !pixels_.has_alpha; i += 4)
      pixels_.has_alpha = result.rgba[i] < 255;
    pixels_.frames.push_back(std::move(result));
  }

  void warn(const std::string& warning) { pixels_.warnings.push_back(warning); }

  Pixels finish() {
    if (resized_ > 0) {
      warn(text(resized_, " images differ in size from what the data set says (", first_resized_,
                "); their intrinsics are scaled"));
    }
    return std::move(pixels_);
  }

 private:
  Camera fitted(const Camera& camera, const Frame& frame, const Image& image) {
    if (camera.width == image.width && camera.height == image.height) return camera;
    const std::string sizes = text(frame.image, ": ", image.width, "x", image.height, " pixels, listed as ",
                                   camera.width, "x", camera.height);
    const double stretch = double(image.width) * camera.height / (double(image.height) * camera.width);
    if (std::abs(stretch - 1) > 0.01)
      throw Error(Fault::data, text(sizes, ": another aspect ratio, so another camera"));
    if (resized_++ == 0) first_resized_ = sizes;
    return resized(camera, image.width, image.height);
  }

  std::vector<std::uint8_t> read_mask(const Frame& frame, const Image& image) const {
    const Image mask = read_image(resolve_inside(scene_.root, *frame.mask));
    if (mask.width == image.width && mask.height == image.height) return as_mask(mask, options_.downscale);
    throw Error(Fault::data, text(*frame.mask, ": the mask has ", mask.width, "x", mask.height, " pixels, its image ",
                                  frame.image, " has ", image.width, "x", image.height));
  }

  const Scene& scene_;
  LoadOptions options_;
  Pixels pixels_;
  int resized_ = 0;
  std::string first_resized_;
};

}  // namespace

Pixels load_images(const Scene& scene, Split split, const LoadOptions& options) {
  if (options.downscale < 1) throw Error(Fault::usage, text("--downscale ", options.downscale, ": want 1 or more"));
  Loader loader(scene, options);
  for (const std::size_t index : frames_of(scene, split)) {
    try {
      loader.load(index);
    } catch (const Error& error) {
      if (!options.skip_bad || error.fault() != Fault::data) throw;
      loader.warn(text("frame dropped: ", error.what()));
    }
  }
  return loader.finish();
}

}  // namespace cloam
