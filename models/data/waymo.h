// The Waymo Open Dataset as plain files: a folder of one drive, as DriveStudio (Chen et al. 2024, "OmniRe") writes it
// from Waymo's own; github.com/ziyc/drivestudio, datasets/waymo.
#pragma once
#include "models/data/reader.h"

namespace cloam {

/// A folder that holds ego_pose/000.txt, extrinsics/0.txt and intrinsics/0.txt.
bool is_waymo(const std::filesystem::path& root);

/// A frame is a step, ten a second: the folder has no time stamps. World frame: that of the poses (z up, metres), the
/// origin where the car is at first. Sweeps hold the returns of the LiDAR on the roof alone. Files that are missing are
/// warned of and skipped; Fault::data for those that are damaged.
Scene read_waymo(const std::filesystem::path& root, const ReadOptions& options);

/// One return of a sweep's file is so many float32: the LiDAR's place, the point (both in axes of the car: x forward,
/// y left, z up), its velocity and class, whether it is ground, intensity, elongation and number of the LiDAR.
constexpr std::size_t kWaymoPointNumbers = 14;

}  // namespace cloam
