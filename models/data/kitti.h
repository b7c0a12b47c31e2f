// KITTI's raw data: a drive's folder (..._sync) with images, velodyne scans, OXTS (GPS and inertial) and tracklets, and
// the calibration in the folder above. cvlibs.net/datasets/kitti/raw_data.php; Geiger et al., Vision meets robotics,
// 2013
#pragma once
#include "models/data/reader.h"

namespace cloam {

/// The folder of a drive, or one that holds drives, also below folders of their dates.
bool is_kitti(const std::filesystem::path& root);

/// The one drive in `root`; Fault::data that lists them if there are several. Any subset of the cameras 00 to 03 will
/// do, and velodyne or tracklets may be absent. Images and scans that are missing, or have no pose, are warned of and
/// skipped. World frame: x east, y north, z up, metres, the origin at the car's first pose. Steps are frame numbers.
Scene read_kitti(const std::filesystem::path& root, const ReadOptions& options);

}  // namespace cloam
