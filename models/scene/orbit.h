// A turntable around what a capture looks at.
#pragma once
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// `count` poses (world_from_camera) on a circle around the point that the cameras look at: up axis, height and
/// distance are the cameras' own means. The first pose lies nearest to the first camera's direction.
std::vector<Eigen::Matrix4d> orbit_poses(const Scene& scene, int count);

}  // namespace cloam
