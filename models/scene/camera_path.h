// A camera that moves through the cameras of a capture.
#pragma once
#include <string>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// A camera's pose and the second of the scene's clock at which it stands there (0 in captures without time stamps).
struct CameraMoment {
  Eigen::Matrix4d world_from_camera;
  double time = 0;
};

/// The frames of a sensor ("": photos), as images of a walk are named: by step, then by path with numbers as numbers
/// (r_2 before r_10).
std::vector<Frame> frames_in_order(const Scene& scene, const std::string& sensor);

/// `count` moments from the first of `stops` (one or more) to the last, all stops the same number of moments apart:
/// positions on a spline, rotations spherical and times linear between neighbours. Where a moment falls on a stop it is
/// the stop.
std::vector<CameraMoment> interpolated_path(const std::vector<Frame>& stops, int count);

}  // namespace cloam
