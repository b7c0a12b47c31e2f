// See orbit.h.
#include "models/scene/orbit.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace cloam {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Vector3d position(const Frame& frame) { return frame.world_from_camera.block<3, 1>(0, 3); }
Vector3d forward(const Frame& frame) { return frame.world_from_camera.block<3, 1>(0, 2); }

/// The point with the least sum of squared distances to the optical axes: sum (I - d d^T) (x - o) = 0. The small
/// weights keep it solvable for parallel axes.
Vector3d focus(const Scene& scene) {
  Matrix3d normal = Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (const Frame& frame : scene.frames) {
    const Matrix3d across = Matrix3d::Identity() * (1 + 1e-6) - forward(frame) * forward(frame).transpose();
    normal += across;
    right += across * position(frame);
  }
  return normal.ldlt().solve(right);
}

Vector3d mean_up(const Scene& scene) {
  Vector3d up = Vector3d::Zero();
  for (const Frame& frame : scene.frames) up -= frame.world_from_camera.block<3, 1>(0, 1);
  // Cameras that look from all sides have no common up: then the source's axis holds.
  return up.norm() > 0.1 * static_cast<double>(scene.frames.size()) ? up.normalized() : scene.up.normalized();
}

Eigen::Matrix4d looking_at(const Vector3d& eye, const Vector3d& target, const Vector3d& up) {
  const Vector3d z = (target - eye).normalized();
  const Vector3d x = z.cross(up).normalized();
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  pose.block<3, 1>(0, 0) = x;
  pose.block<3, 1>(0, 1) = z.cross(x);
  pose.block<3, 1>(0, 2) = z;
  pose.block<3, 1>(0, 3) = eye;
  return pose;
}

}  // namespace

std::vector<Eigen::Matrix4d> orbit_poses(const Scene& scene, int count) {
  const Vector3d centre = focus(scene), up = mean_up(scene);
  double height = 0, radius = 0;
  for (const Frame& frame : scene.frames) {
    const Vector3d arm = position(frame) - centre;
    height += arm.dot(up);
    radius += (arm - arm.dot(up) * up).norm();
  }
  height /= static_cast<double>(scene.frames.size());
  radius = std::max(radius / static_cast<double>(scene.frames.size()), 1e-6);
  Vector3d first = position(scene.frames.front()) - centre;
  first -= first.dot(up) * up;
  if (first.norm() < 1e-9) first = up.unitOrthogonal();
  std::vector<Eigen::Matrix4d> poses;
  for (int i = 0; i < count; ++i) {
    const Eigen::AngleAxisd turn(2 * std::numbers::pi * i / count, up);
    poses.push_back(looking_at(centre + turn * first.normalized() * radius + height * up, centre, up));
  }
  return poses;
}

}  // namespace cloam
