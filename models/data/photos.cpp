// See photos.h.
#include "models/data/photos.h"

#include <algorithm>

#include "models/data/near_misses.h"
#include "models/io/image.h"
#include "models/io/paths.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

std::string warning_of(const std::vector<std::string>& missing, const Scene& scene) {
  return text(missing.size(), " of ", scene.frames_listed, " listed images are missing and skipped: ", some_of(missing),
              near_misses(scene.root, missing));
}

bool first_image_has_alpha(const Scene& scene, const ReadOptions& options) {
  for (const Frame& frame : scene.frames) {
    try {
      return read_image_size(scene.root / frame.image).channels % 2 == 0;
    } catch (const Error&) {
      if (!options.skip_bad) throw;
    }
  }
  return false;
}

void add_masks(Scene& scene) {
  std::error_code error;
  if (!fs::is_directory(scene.root / "masks", error)) return;
  std::vector<std::string> without;
  for (Frame& frame : scene.frames) {
    if (!frame.mask) frame.mask = find_mask(scene.root, frame.image);
    if (!frame.mask) without.push_back(frame.image);
  }
  if (without.empty()) return;
  const std::string name = fs::path(without.front()).filename().string();
  scene.warnings.push_back(text(without.size(), " of ", scene.frames.size(),
                                " images have no mask in masks/: ", without.front(), " needs masks/", name,
                                ".png or masks/", fs::path(name).replace_extension(".png").string()));
}

/// Of images/NAME.jpg the name by which other folders have a file for it.
fs::path name_beside(const std::string& image) {
  fs::path name = image;
  if (*name.begin() == "images") name = name.lexically_relative("images");
  return name.is_absolute() || *name.begin() == ".." ? name.filename() : name;  // an image outside of the folder
}

/// What COLMAP's stereo writes, made consistent over photos.
void add_stereo_depths(Scene& scene) {
  const fs::path folder = "stereo/depth_maps";
  std::error_code error;
  if (!fs::is_directory(scene.root / folder, error)) return;
  for (Frame& frame : scene.frames) {
    const fs::path file = folder / (name_beside(frame.image).string() + ".geometric.bin");
    if (!frame.depth && is_file(scene.root / file)) frame.depth = DepthMap{file.generic_string(), {}};
  }
}

}  // namespace

std::optional<std::string> find_mask(const fs::path& root, const std::string& image) {
  const fs::path mask = "masks" / name_beside(image);
  for (const fs::path& candidate : {fs::path(mask.string() + ".png"), fs::path(mask).replace_extension(".png"), mask}) {
    if (is_file(root / candidate.generic_string())) return candidate.generic_string();
  }
  return std::nullopt;
}

void finish_photos(Scene& scene, const std::vector<std::string>& missing, const ReadOptions& options) {
  if (!missing.empty()) scene.warnings.push_back(warning_of(missing, scene));
  if (scene.frames.empty()) {
    throw Error(
        Fault::data,
        text(scene.root.string(), ": no usable image: ", scene.frames_listed, " listed, ", missing.size(), " missing",
             missing.empty() ? "" : " (first: " + missing.front() + ")", near_misses(scene.root, missing),
             "\n  fix: copy the images to where the list has them, or correct the list"));
  }
  add_masks(scene);
  add_stereo_depths(scene);
  scene.has_alpha = first_image_has_alpha(scene, options);
}

}  // namespace cloam
