// See orbit.h.
#include "models/scene/orbit.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace cloam {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kPi = std::numbers::pi;
constexpr double kLargestGap = kPi * 150 / 180;
constexpr double kTurntableView = kPi * 30 / 180;

Vector3d forward_of(const Frame& frame) { return frame.world_from_camera.block<3, 1>(0, 2); }

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

/// The part of the circle that the cameras stand on: the angle of its middle about `up`, and its half width.
struct Arc {
  double middle = 0, half = kPi;
};

Arc covered_arc(const std::vector<double>& sorted) {
  Arc arc;
  double widest = kLargestGap;
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    const double next = i + 1 < sorted.size() ? sorted[i + 1] : sorted[0] + 2 * kPi;
    const double gap = next - sorted[i];
    if (gap > widest) arc = {next - 2 * kPi + (2 * kPi - gap) / 2, (2 * kPi - gap) / 2};
    widest = std::max(widest, gap);
  }
  return arc;
}

/// Where the cameras stand around `centre`: heights above it along `up`, distances from the axis, and angles about it.
struct Ring {
  Vector3d ahead, aside;  // angle 0, angle 90 degrees
  double height = 0, radius = 0;
  Arc arc;
};

Ring ring_of(const Scene& scene, const Vector3d& centre, const Vector3d& up) {
  Ring ring;
  ring.ahead = up.unitOrthogonal();
  ring.aside = up.cross(ring.ahead);
  std::vector<double> angles;
  const auto count = static_cast<double>(scene.frames.size());
  for (const Frame& frame : scene.frames) {
    const Vector3d arm = frame.position() - centre;
    ring.height += arm.dot(up) / count;
    ring.radius += (arm - arm.dot(up) * up).norm() / count;
    angles.push_back(std::atan2(arm.dot(ring.aside), arm.dot(ring.ahead)));
  }
  std::sort(angles.begin(), angles.end());
  ring.arc = covered_arc(angles);
  ring.radius = std::max(ring.radius, 1e-6);
  return ring;
}

}  // namespace

/// sum (I - d d^T) (x - o) = 0; the small weights keep it solvable for parallel axes.
Vector3d looked_at(const Scene& scene) {
  Matrix3d normal = Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (const Frame& frame : scene.frames) {
    const Matrix3d across = Matrix3d::Identity() * (1 + 1e-6) - forward_of(frame) * forward_of(frame).transpose();
    normal += across;
    right += across * frame.position();
  }
  return normal.ldlt().solve(right);
}

std::vector<Eigen::Matrix4d> orbit_poses(const Scene& scene, int count) {
  const Vector3d centre = looked_at(scene), up = mean_up(scene);
  const Ring ring = ring_of(scene, centre, up);
  const bool full = ring.arc.half >= kPi;
  std::vector<Eigen::Matrix4d> poses;
  for (int i = 0; i < count; ++i) {
    const double turn = 2 * kPi * i / count;
    const double angle = ring.arc.middle + (full ? turn : ring.arc.half * std::sin(turn));
    const Vector3d arm = std::cos(angle) * ring.ahead + std::sin(angle) * ring.aside;
    poses.push_back(looking_at(centre + ring.radius * arm + ring.height * up, centre, up));
  }
  return poses;
}

Camera turntable_camera(int width, int height) {
  const double focal = 0.5 * std::min(width, height) / std::tan(0.5 * kTurntableView);
  return {width, height, focal, focal, 0.5 * width, 0.5 * height, CameraModel::pinhole, {}, 0, 0};
}

std::vector<Eigen::Matrix4d> turntable_poses(const Vector3d& size, const Camera& camera, int count, double height) {
  const double half_view = std::atan(std::min(camera.width / camera.fx, camera.height / camera.fy) / 2);
  const double distance = 0.5 * size.norm() / std::sin(half_view);  // the sphere about the box touches the view's rim
  std::vector<Eigen::Matrix4d> poses;
  for (int i = 0; i < count; ++i) {
    const double angle = 2 * kPi * i / count;
    const Vector3d level(-std::sin(angle), std::cos(angle), 0);
    const Vector3d arm = std::cos(height) * level + std::sin(height) * Vector3d::UnitZ();
    poses.push_back(looking_at(distance * arm, Vector3d::Zero(), Vector3d::UnitZ()));
  }
  return poses;
}

Eigen::Matrix4d three_quarter_pose(const Vector3d& size, const Camera& camera) {
  return turntable_poses(size, camera, 8)[1];
}

}  // namespace cloam
