// A plain layout for drives with a car of one's own: rig.json with cameras, poses and boxes, beside it images and LiDAR
// points as .ply or .npy. docs/formats.md has all keys and an example.
#pragma once
#include "models/data/reader.h"

namespace cloam {

bool is_rig(const std::filesystem::path& root);

/// A sweep is a step, with the image of each camera and the box of each actor that are nearest in time; without sweeps
/// the images of the camera that has most are. Images and sweeps that are missing are warned of and skipped, as are
/// images and boxes beyond one a step. Errors name the JSON key.
Scene read_rig(const std::filesystem::path& root, const ReadOptions& options);

}  // namespace cloam
