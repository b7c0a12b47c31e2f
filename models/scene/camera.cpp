// Projection and its inverse for each lens; the inverse is Newton's method in double precision, or a closed form.
#include "models/scene/camera.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kNewtonSteps = 30;
constexpr double kConverged = 1e-12;  // in normalised coordinates: far below a millionth of a pixel

struct Distorted {
  Eigen::Vector2d value;
  Eigen::Matrix2d jacobian;
};

// The distortion of a point of the lens's plane, and its derivative.
// docs.opencv.org, "Camera Calibration and 3D Reconstruction": x' = x g(r2) + 2 p1 x y + p2 (r2 + 2 x^2) + s1 r2, y'
// alike.
Distorted distort(const Camera& camera, const Eigen::Vector2d& at) {
  const double x = at.x(), y = at.y(), r2 = at.squaredNorm();
  const auto& k = camera.k;
  const auto& d = camera.denominator;
  const auto& s = camera.prism;
  const double over = 1 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3])));
  const double over_slope = k[0] + r2 * (2 * k[1] + r2 * (3 * k[2] + r2 * 4 * k[3]));  // d over / d r2
  const double under = 1 + r2 * (d[0] + r2 * (d[1] + r2 * d[2]));
  const double under_slope = d[0] + r2 * (2 * d[1] + r2 * 3 * d[2]);
  const double gain = over / under, slope = (over_slope - gain * under_slope) / under;
  const double p1 = camera.p1, p2 = camera.p2;
  Distorted result;
  result.value = {x * gain + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + s[0] * r2,
                  y * gain + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + s[1] * r2};
  const double mixed = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y;
  result.jacobian << gain + 2 * x * x * slope + 2 * p1 * y + (6 * p2 + 2 * s[0]) * x, mixed + 2 * s[0] * y,
      mixed + 2 * s[1] * x, gain + 2 * y * y * slope + (6 * p1 + 2 * s[1]) * y + 2 * p2 * x;
  return result;
}

Eigen::Vector2d within(const Eigen::Vector2d& at, double farthest) {
  const double radius = at.norm();
  return radius > farthest ? Eigen::Vector2d(at * (farthest / radius)) : at;
}

// The point no further than `farthest` that distort() takes to `wanted`. Keeps the best point seen: outside the fitted
// circle the polynomial may fold back and Newton may run away.
Eigen::Vector2d undistort(const Camera& camera, const Eigen::Vector2d& wanted, double farthest) {
  Eigen::Vector2d at = within(wanted, farthest), best = at;
  double best_error = (distort(camera, at).value - wanted).norm();
  for (int step = 0; step < kNewtonSteps && best_error > kConverged; ++step) {
    const Distorted now = distort(camera, at);
    at = within(at - now.jacobian.inverse() * (now.value - wanted), farthest);
    const double error = (distort(camera, at).value - wanted).norm();
    if (!std::isfinite(error)) break;
    if (error >= best_error) continue;
    best = at;
    best_error = error;
  }
  return best;
}

// The unit vector at `angle` from the axis, towards `at`.
Eigen::Vector3d at_angle(double angle, const Eigen::Vector2d& at) {
  const double radius = at.norm();
  if (radius == 0) return Eigen::Vector3d::UnitZ();
  const double side = std::sin(angle) / radius;
  return {side * at.x(), side * at.y(), std::cos(angle)};
}

double angle_of(const Eigen::Vector3d& point) { return std::atan2(point.head<2>().norm(), point.z()); }

// The point at `radius` from the axis, towards (x, y) of `point`.
Eigen::Vector2d at_radius(double radius, const Eigen::Vector3d& point) {
  const double side = point.head<2>().norm();
  if (side == 0) return Eigen::Vector2d::Zero();
  return point.head<2>() / side * radius;
}

double fov_scale(const Camera& camera) { return 2 * std::tan(camera.k[0] / 2); }

Eigen::Vector3d fov_direction(const Camera& camera, const Eigen::Vector2d& at) {
  const double turn = std::min(at.norm() * camera.k[0], std::numbers::pi);
  return at_angle(std::atan2(std::sin(turn), fov_scale(camera) * std::cos(turn)), at);
}

// atan2 goes on where tan(angle) ends, at a right angle to the axis.
Eigen::Vector2d fov_point(const Camera& camera, const Eigen::Vector3d& point) {
  const double turn = std::atan2(fov_scale(camera) * point.head<2>().norm(), point.z());
  return at_radius(turn / camera.k[0], point);
}

Eigen::Vector3d fisheye_direction(const Camera& camera, const Eigen::Vector2d& at) {
  const Eigen::Vector2d straight = undistort(camera, at, std::numbers::pi);
  return at_angle(straight.norm(), straight);
}

Eigen::Vector2d lens_point(const Camera& camera, const Eigen::Vector3d& point) {
  if (camera.model == CameraModel::pinhole) return point.hnormalized();
  if (camera.model == CameraModel::fov) return fov_point(camera, point);
  const bool fisheye = camera.model == CameraModel::fisheye;
  return distort(camera, fisheye ? at_radius(angle_of(point), point) : Eigen::Vector2d(point.hnormalized())).value;
}

}  // namespace

Eigen::Vector3d direction(const Camera& camera, const Eigen::Vector2d& point) {
  const Eigen::Vector2d at{(point.x() - camera.cx) / camera.fx, (point.y() - camera.cy) / camera.fy};
  if (camera.model == CameraModel::pinhole) return at.homogeneous();
  if (camera.model == CameraModel::fov) return fov_direction(camera, at);
  if (camera.model == CameraModel::fisheye) return fisheye_direction(camera, at);
  return undistort(camera, at, std::numeric_limits<double>::infinity()).homogeneous();
}

std::vector<float> pixel_directions(const Camera& camera) {
  std::vector<float> directions;
  directions.reserve(std::size_t{3} * camera.width * camera.height);
  for (int row = 0; row < camera.height; ++row) {
    for (int column = 0; column < camera.width; ++column) {
      const Eigen::Vector3f ray = direction(camera, {column + 0.5, row + 0.5}).cast<float>();
      directions.insert(directions.end(), {ray.x(), ray.y(), ray.z()});
    }
  }
  return directions;
}

Eigen::Vector2d project(const Camera& camera, const Eigen::Vector3d& point_in_camera) {
  const Eigen::Vector2d at = lens_point(camera, point_in_camera);
  return {camera.fx * at.x() + camera.cx, camera.fy * at.y() + camera.cy};
}

Camera with_lens(const Camera& camera, const LensChange& change) {
  Camera out = camera;
  const double factor = change.focal;
  out.cx += camera.fx * change.centre.x(), out.cy += camera.fy * change.centre.y();
  out.fx *= factor, out.fy *= factor;
  // Terms in the second, fourth, ... power of the radius beside 1, and those of the second power alone.
  double even = 1;
  for (std::size_t i = 0; i < out.k.size(); ++i) {
    even *= factor * factor;
    out.k[i] *= even;
    if (i < out.denominator.size()) out.denominator[i] *= even;
  }
  for (double* term : {&out.p1, &out.p2, &out.prism[0], &out.prism[1]}) *term *= factor;
  return out;
}

Camera scaled(const Camera& camera, int factor) {
  if (factor < 1 || factor > camera.width || factor > camera.height) {
    throw Error(Fault::usage, text("--downscale ", factor, ": images are ", camera.width, "x", camera.height,
                                   ", want a factor from 1 to ", std::min(camera.width, camera.height)));
  }
  Camera result = camera;
  result.width /= factor;
  result.height /= factor;
  for (double* length : {&result.fx, &result.fy, &result.cx, &result.cy}) *length /= factor;
  return result;
}

Camera resized(const Camera& camera, int width, int height) {
  Camera result = camera;
  const double across = static_cast<double>(width) / camera.width, down = static_cast<double>(height) / camera.height;
  result.width = width;
  result.height = height;
  result.fx *= across;
  result.cx *= across;
  result.fy *= down;
  result.cy *= down;
  return result;
}

}  // namespace cloam
