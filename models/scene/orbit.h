// Turntables: around what a capture looks at, and around one box.
#pragma once
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// The point with the least sum of squared distances to the cameras' optical axes: what they look at.
Eigen::Vector3d looked_at(const Scene& scene);

/// `count` poses (world_from_camera) of a closed path around the point that the cameras look at; up axis, height and
/// distance are the cameras' own means. Where the cameras stand all around it is a circle; where they stand on one side
/// (a gap of more than 150 degrees) it goes to and fro over the side that they saw.
std::vector<Eigen::Matrix4d> orbit_poses(const Scene& scene, int count);

/// A camera with a narrow view, so that things look much as they are, for turntable_poses.
Camera turntable_camera(int width, int height);

/// `count` poses (box_from_camera) around a box of that size about the origin, x right, y forward, z up: from its front
/// counter-clockwise, as far away as makes any box fit into the view of the camera. height: above the horizon, radians.
constexpr double kTurntableHeight = 0.31415926535897931;  // 18 degrees
std::vector<Eigen::Matrix4d> turntable_poses(const Eigen::Vector3d& size, const Camera& camera, int count,
                                             double height = kTurntableHeight);

/// Where assets show most of themselves: from the front left, as turntable_poses have it.
Eigen::Matrix4d three_quarter_pose(const Eigen::Vector3d& size, const Camera& camera);

}  // namespace cloam
