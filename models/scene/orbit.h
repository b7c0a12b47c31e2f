// A turntable around what a capture looks at.
#pragma once
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// `count` poses (world_from_camera) of a closed path around the point that the cameras look at; up axis, height and
/// distance are the cameras' own means. Where the cameras stand all around it is a circle; where they stand on one side
/// (a gap of more than 150 degrees) it goes to and fro over the side that they saw.
std::vector<Eigen::Matrix4d> orbit_poses(const Scene& scene, int count);

}  // namespace cloam
