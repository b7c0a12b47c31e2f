// Projection and its inverse for the three lens models; the inverse is Newton's method in double precision.
#include "models/scene/camera.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
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

// The OpenCV lens at normalised (x, y) and its derivative.
// docs.opencv.org, "Camera Calibration and 3D Reconstruction": x' = x g(r2) + 2 p1 x y + p2 (r2 + 2 x^2), y' alike.
Distorted distort(const Camera& camera, const Eigen::Vector2d& at) {
  const double x = at.x(), y = at.y(), r2 = at.squaredNorm();
  const auto& k = camera.k;
  const double gain = 1 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3])));
  const double slope = k[0] + r2 * (2 * k[1] + r2 * (3 * k[2] + r2 * 4 * k[3]));  // d gain / d r2
  const double p1 = camera.p1, p2 = camera.p2;
  Distorted result;
  result.value = {x * gain + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * gain + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
  const double mixed = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y;
  result.jacobian << gain + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x, mixed, mixed,
      gain + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x;
  return result;
}

// Keeps the best point seen: outside the fitted circle the polynomial may fold back and Newton may run away.
Eigen::Vector2d undistort(const Camera& camera, const Eigen::Vector2d& wanted) {
  Eigen::Vector2d at = wanted, best = wanted;
  double best_error = (distort(camera, at).value - wanted).norm();
  for (int step = 0; step < kNewtonSteps && best_error > kConverged; ++step) {
    const Distorted now = distort(camera, at);
    at -= now.jacobian.inverse() * (now.value - wanted);
    const double error = (distort(camera, at).value - wanted).norm();
    if (!std::isfinite(error)) break;
    if (error >= best_error) continue;
    best = at;
    best_error = error;
  }
  return best;
}

double fisheye_radius(const Camera& camera, double angle) {
  const double a2 = angle * angle;
  const auto& k = camera.k;
  return angle * (1 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3]))));
}

double fisheye_slope(const Camera& camera, double angle) {
  const double a2 = angle * angle;
  const auto& k = camera.k;
  return 1 + a2 * (3 * k[0] + a2 * (5 * k[1] + a2 * (7 * k[2] + a2 * 9 * k[3])));
}

// The angle from the optical axis, within [0, pi], whose image lies at `radius`.
double fisheye_angle(const Camera& camera, double radius) {
  double angle = std::clamp(radius, 0.0, std::numbers::pi), best = angle;
  double best_error = std::abs(fisheye_radius(camera, angle) - radius);
  for (int step = 0; step < kNewtonSteps && best_error > kConverged; ++step) {
    angle -= (fisheye_radius(camera, angle) - radius) / fisheye_slope(camera, angle);
    if (!std::isfinite(angle)) break;
    angle = std::clamp(angle, 0.0, std::numbers::pi);
    const double error = std::abs(fisheye_radius(camera, angle) - radius);
    if (error >= best_error) continue;
    best = angle;
    best_error = error;
  }
  return best;
}

Eigen::Vector3d fisheye_direction(const Camera& camera, const Eigen::Vector2d& at) {
  const double radius = at.norm();
  if (radius == 0) return Eigen::Vector3d::UnitZ();
  const double angle = fisheye_angle(camera, radius), side = std::sin(angle) / radius;
  return {side * at.x(), side * at.y(), std::cos(angle)};
}

Eigen::Vector2d fisheye_point(const Camera& camera, const Eigen::Vector3d& point) {
  const double side = point.head<2>().norm();
  if (side == 0) return Eigen::Vector2d::Zero();
  return point.head<2>() / side * fisheye_radius(camera, std::atan2(side, point.z()));
}

}  // namespace

Eigen::Vector3d direction(const Camera& camera, const Eigen::Vector2d& point) {
  const Eigen::Vector2d at{(point.x() - camera.cx) / camera.fx, (point.y() - camera.cy) / camera.fy};
  if (camera.model == CameraModel::fisheye) return fisheye_direction(camera, at);
  return (camera.model == CameraModel::opencv ? undistort(camera, at) : at).homogeneous();
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
  Eigen::Vector2d at;
  if (camera.model == CameraModel::fisheye) {
    at = fisheye_point(camera, point_in_camera);
  } else {
    at = point_in_camera.hnormalized();
    if (camera.model == CameraModel::opencv) at = distort(camera, at).value;
  }
  return {camera.fx * at.x() + camera.cx, camera.fy * at.y() + camera.cy};
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
