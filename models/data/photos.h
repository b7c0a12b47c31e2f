// What all captures of photos have in common, whatever their format.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "models/data/reader.h"

namespace cloam {

/// Once all frames are read: one warning for listed images that are missing and where they may be instead, masks by
/// their names (find_mask) for frames without one, with a warning if some have none, depth maps of COLMAP's stereo
/// (stereo/depth_maps/NAME.geometric.bin) likewise, and has_alpha by the first image.
/// Fault::data if no frame is left.
void finish_photos(Scene& scene, const std::vector<std::string>& missing, const ReadOptions& options);

/// Of images/NAME.jpg the first that exists of masks/NAME.jpg.png (COLMAP's naming), masks/NAME.png and masks/NAME.jpg.
std::optional<std::string> find_mask(const std::filesystem::path& root, const std::string& image);

}  // namespace cloam
