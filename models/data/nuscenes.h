// nuScenes: a folder with the tables of a version (v1.0-mini/*.json, v1.0-trainval/*.json) beside samples/ and sweeps/.
// Its scenes are logs of 20 seconds. nuscenes.org; Caesar et al., nuScenes: a multimodal dataset for autonomous
// driving, 2020; the devkit's docs/schema_nuscenes.md
#pragma once
#include <string>

#include "models/data/reader.h"

namespace cloam {

/// A folder that holds v1.0-*/scene.json and v1.0-*/sample_data.json.
bool is_nuscenes(const std::filesystem::path& root);

/// The scene of that name ("scene-0061"); "" stands for the only one. Fault::data that lists them if there are several,
/// or none of the name. A sweep of LIDAR_TOP is a step (20 a second), key frame or not; it takes of each camera the
/// image nearest in time, and boxes, which people drew in key frames (2 a second), on the way between two. World frame:
/// that of nuScenes' map (z up, metres), the origin where the car is at first. Files that are missing are warned of and
/// skipped.
Scene read_nuscenes_scene(const std::filesystem::path& root, const std::string& name, const ReadOptions& options);

/// The only scene.
Scene read_nuscenes(const std::filesystem::path& root, const ReadOptions& options);

}  // namespace cloam
