// See load_images.h. One image a core is held at full size.
#include "models/data/load_images.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <functional>
#include <map>
#include <numeric>
#include <set>
#include <tuple>

#include "models/data/depth_map.h"
#include "models/data/reader.h"
#include "models/io/image.h"
#include "models/io/in_parallel.h"
#include "models/io/words.h"
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

std::string told(const Remark& remark, const char* what, const char* why) {
  return text(remark.images, " images (", remark.first, ", ...) ", what, ": ", why);
}

constexpr char kOtherSize[] = "do not have the size that the data set lists", kScaled[] = "their intrinsics are scaled";

/// "a.png: 16x12 pixels, listed as 8x6".
std::string sizes_of(const Frame& frame, const ImageSize& seen, const Camera& listed) {
  return text(frame.image, ": ", seen.width, "x", seen.height, " pixels, listed as ", listed.width, "x", listed.height);
}

/// The EXIF orientation to follow; 1: as stored.
int turn_of(const Camera& camera, const Image& image) { return must_turn(camera, image) ? image.orientation : 1; }

/// The photo's size as its camera sees it.
ImageSize seen_size(const Camera& camera, const Image& header) {
  if (turn_of(camera, header) < 5) return {header.width, header.height};
  return {header.height, header.width};
}

/// Images without pixels; `troubles`: why there is none.
std::vector<Image> read_headers(const Scene& scene, const std::vector<std::size_t>& frames,
                                std::vector<std::exception_ptr>& troubles) {
  std::vector<Image> headers(frames.size());
  troubles.resize(frames.size());
  in_parallel(frames.size(), [&](std::size_t i) {
    try {
      const ImageSize size = peek_image_size(scene.root / scene.frames[frames[i]].image);
      headers[i] = {size.width, size.height, size.channels, {}, size.orientation};
    } catch (...) { troubles[i] = std::current_exception(); }
  });
  return headers;
}

/// The frame that a photo shows.
struct PhotoFile {
  const std::filesystem::path& root;
  const Frame& frame;
  const Camera& camera;  // as listed

  PhotoFile(const Scene& scene, const FramePixels& photo)
      : root(scene.root),
        frame(scene.frames[photo.frame]),
        camera(scene.cameras[static_cast<std::size_t>(frame.camera)]) {}
};

/// The photos of a split by their headers.
class Lister {
 public:
  Lister(const Scene& scene, const LoadOptions& options) : scene_(scene), options_(options) {}

  void list(Split split) {
    const std::vector<std::size_t> frames = frames_of(scene_, split);
    std::vector<std::exception_ptr> troubles;
    const std::vector<Image> headers = read_headers(scene_, frames, troubles);
    for (std::size_t i = 0; i < frames.size(); ++i) {
      guarded(options_.skip_bad, listed.warnings, "frame dropped", [&] {
        if (troubles[i]) std::rethrow_exception(troubles[i]);
        list(frames[i], headers[i]);
      });
    }
    warn(resized_, kOtherSize, kScaled);
    warn(turned_, "are rotated as their EXIF orientation says", "the data set lists the rotated size");
    warn(left_, "have an EXIF orientation that is ignored", "the listed size is that of the stored image");
  }

  PhotoFile file(std::size_t place) const { return {scene_, listed.frames[place]}; }

  Pixels listed;
  PhotoPlanes planes;

 private:
  /// header: an image without pixels.
  void list(std::size_t index, const Image& header) {
    const Frame& frame = scene_.frames[index];
    const Camera& camera = scene_.cameras[static_cast<std::size_t>(frame.camera)];
    const int turn = turn_of(camera, header);
    if (turn != 1) turned_.add(frame.image);
    if (turn == 1 && header.orientation != 1) left_.add(frame.image);
    const ImageSize seen = seen_size(camera, header);
    const Camera full = fitted(camera, frame, seen);
    if (options_.downscale > std::min(seen.width, seen.height))
      (void)downscale({seen.width, seen.height, 1, {}}, options_.downscale);
    const Camera small = scaled(full, options_.downscale);
    listed.frames.push_back({index, find_or_add(listed.cameras, small), small.width, small.height, {}, {}});
    planes.masks |= frame.ego_rows > 0 || (frame.mask && options_.masks == MaskMeaning::ignore);
    planes.depths |= options_.depths && frame.depth;
  }

  void warn(const Remark& remark, const char* what, const char* why) {
    if (remark.images > 0) listed.warnings.push_back(told(remark, what, why));
  }

  Camera fitted(const Camera& camera, const Frame& frame, const ImageSize& seen) {
    if (camera.width == seen.width && camera.height == seen.height) return camera;
    const std::string sizes = sizes_of(frame, seen, camera);
    if (!has_aspect(camera, seen.width, seen.height))
      bad_data(sizes,
               ": the aspect ratio differs, so the intrinsics cannot be scaled to it; correct w and h "
               "there, or give the images that it was made for");
    resized_.add(sizes);
    return resized(camera, seen.width, seen.height);
  }

  const Scene& scene_;
  LoadOptions options_;
  Remark resized_, turned_, left_;
};

Image photo_in(const std::filesystem::path& root, const Frame& frame, bool opaque = false) {
  const bool is_exr = lower_case(std::filesystem::path(frame.image).extension().string()) == ".exr";
  return read_photo(root / frame.image, {frame.linear.value_or(is_exr), frame.exposure, opaque});
}

Image read_mask(const PhotoFile& file, const Image& image, int turn) {
  Image mask = read_image(file.root / *file.frame.mask);
  if (mask.width != image.width || mask.height != image.height) mask = upright(mask, turn);  // drawn as stored
  if (mask.width == image.width && mask.height == image.height) return mask;
  bad_data(*file.frame.mask, ": the mask has ", mask.width, "x", mask.height, " pixels, but its image ",
           file.frame.image, " has ", image.width, "x", image.height);
}

/// Nothing is known of pixels that do not count.
void forget_unused(FramePixels& photo) {
  for (std::size_t i = 0; i < photo.depth.size(); ++i)
    if (photo.rgba[4 * i + 3] < kMaskThreshold || (!photo.mask.empty() && photo.mask[i] == 0)) photo.depth[i] = 0;
}

/// The photo that was listed as `outline`.
FramePixels load(const PhotoFile& file, const FramePixels& outline, const LoadOptions& options) {
  FramePixels result = outline;
  Image full = photo_in(file.root, file.frame, options.downscale == 1);
  const int turn = turn_of(file.camera, full);
  full = upright(full, turn);
  if (file.frame.mask) {
    const Image mask = read_mask(file, full, turn);
    if (options.masks == MaskMeaning::ignore) result.mask = as_mask(mask, options.downscale);
    if (options.masks == MaskMeaning::transparent) full = without_background(full, mask);
  }
  const int full_width = full.width, full_height = full.height;
  Image image = options.downscale == 1 ? std::move(full) : downscale(full, options.downscale);
  if (image.width != outline.width || image.height != outline.height)
    bad_data(file.frame.image, ": ", image.width, "x", image.height, " pixels as loaded, ", outline.width, "x",
             outline.height, " when it was listed; restore the file");
  if (file.frame.ego_rows > 0) ignore_ego(result, file.frame.ego_rows, full_height, options.downscale);
  result.rgba = image.channels == 4 ? std::move(image.pixels) : as_rgba(image);
  if (options.depths && file.frame.depth) {
    const DepthPhoto photo{full_width, full_height, turn, options.downscale,
                           scaled(resized(file.camera, full_width, full_height), options.downscale)};
    result.depth = depth_of(file.root, *file.frame.depth, photo);
    forget_unused(result);
  }
  return result;
}

bool has_clear_pixel(const FramePixels& photo) {
  for (std::size_t i = 3; i < photo.rgba.size(); i += 4)
    if (photo.rgba[i] < 255) return true;
  return false;
}

/// Every photo in order; one that is damaged is told as guarded() does.
void load_each(const Lister& list, const LoadOptions& options, std::vector<std::string>& warnings,
               const std::function<void(std::size_t place, FramePixels photo)>& take) {
  const std::size_t count = list.listed.frames.size();
  std::vector<std::exception_ptr> troubles(count);
  in_parallel(count, [&](std::size_t i) {
    try {
      take(i, load(list.file(i), list.listed.frames[i], options));
    } catch (...) {
      troubles[i] = std::current_exception();
      if (!options.skip_bad) throw;
    }
  });
  for (const std::exception_ptr& trouble : troubles)
    guarded(options.skip_bad, warnings, "frame dropped", [&] {
      if (trouble) std::rethrow_exception(trouble);
    });
}

/// Decodes all, to learn which are.
void drop_damaged(Lister& list, const LoadOptions& options) {
  std::vector<char> sound(list.listed.frames.size());
  load_each(list, options, list.listed.warnings, [&](std::size_t place, const FramePixels&) { sound[place] = 1; });
  Pixels kept{list.listed.cameras, {}, false, list.listed.warnings};
  for (std::size_t i = 0; i < sound.size(); ++i)
    if (sound[i]) kept.frames.push_back(list.listed.frames[i]);
  list.listed = std::move(kept);
}

Lister listed(const Scene& scene, Split split, const LoadOptions& options) {
  if (options.downscale < 1) throw Error(Fault::usage, text("--downscale ", options.downscale, ": want 1 or more"));
  Lister list(scene, options);
  list.list(split);
  return list;
}

}  // namespace

void fit_cameras(Scene& scene) {
  std::vector<std::size_t> all(scene.frames.size());
  std::iota(all.begin(), all.end(), 0);
  std::vector<std::exception_ptr> troubles;
  const std::vector<Image> headers = read_headers(scene, all, troubles);
  Remark remark;
  std::vector<Camera> fitted;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Frame& frame = scene.frames[i];
    fitted.push_back(scene.cameras[static_cast<std::size_t>(frame.camera)]);
    const ImageSize seen = seen_size(fitted[i], headers[i]);
    const bool differs = !troubles[i] && (fitted[i].width != seen.width || fitted[i].height != seen.height);
    if (!differs || !has_aspect(fitted[i], seen.width, seen.height)) continue;
    remark.add(sizes_of(frame, seen, fitted[i]));
    fitted[i] = resized(fitted[i], seen.width, seen.height);
  }
  if (remark.images == 0) return;
  // A listed camera stays in its place, at the first size that its photos have; further sizes follow.
  std::map<std::tuple<int, int, int>, int> places;
  std::set<int> taken;
  for (std::size_t i = 0; i < all.size(); ++i) {
    int& camera = scene.frames[i].camera;
    const auto [at, added] = places.try_emplace({camera, fitted[i].width, fitted[i].height}, camera);
    if (added && !taken.insert(camera).second) {
      at->second = static_cast<int>(scene.cameras.size());
      scene.cameras.emplace_back();
    }
    scene.cameras[static_cast<std::size_t>(at->second)] = fitted[i];
    camera = at->second;
  }
  scene.warnings.push_back(told(remark, kOtherSize, kScaled));
}

Image photo_of(const Scene& scene, const Frame& frame) { return photo_in(scene.root, frame); }

Pixels load_images(const Scene& scene, Split split, const LoadOptions& options) {
  const Lister list = listed(scene, split, options);
  Pixels pixels = list.listed;
  load_each(list, options, pixels.warnings,
            [&](std::size_t place, FramePixels photo) { pixels.frames[place] = std::move(photo); });
  std::erase_if(pixels.frames, [](const FramePixels& photo) { return photo.rgba.empty(); });
  pixels.has_alpha = std::any_of(pixels.frames.begin(), pixels.frames.end(), has_clear_pixel);
  return pixels;
}

PhotoStore store_images(const RestingScene& scene, Split split, const LoadOptions& options,
                        const std::shared_ptr<HostStore>& store) {
  const std::shared_ptr<const Scene> now = scene.get();
  Lister list = listed(*now, split, options);
  if (options.skip_bad) drop_damaged(list, options);
  list.listed.frames.shrink_to_fit();
  const auto load_one = [scene, options](const FramePixels& outline) {
    const std::shared_ptr<const Scene> then = scene.get();
    return load({*then, outline}, outline, options);
  };
  return {std::move(list.listed), list.planes, load_one, store};
}

}  // namespace cloam
