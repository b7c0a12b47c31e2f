// See ellipsoids.h.
#include "models/gaussians/ellipsoids.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "models/gaussians/values.h"
#include "models/scene/box_projection.h"

namespace cloam {
namespace {

constexpr std::size_t kBetween = 4096;  // gaussians, until the view is asked again
constexpr double kAmbient = 0.3;

Eigen::Vector3d vector_at(const std::vector<float>& values, std::size_t i) {
  return Eigen::Map<const Eigen::Vector3f>(values.data() + 3 * i).cast<double>();
}

/// In camera axes; `to_ball` takes its surface to the unit sphere.
struct Ellipsoid {
  Eigen::Matrix4d camera_from_box;
  Eigen::Vector3d size, colour;
  Eigen::Matrix3d to_ball;
};

Ellipsoid ellipsoid_of(const Gaussians& g, std::size_t i, const Eigen::Matrix4d& camera_from_world, double deviations) {
  const float* q = g.rotations.data() + 4 * i;
  const Eigen::Quaterniond turn = Eigen::Quaternionf(q[0], q[1], q[2], q[3]).cast<double>().normalized();
  const Eigen::Vector3d radii = deviations * vector_at(g.scales, i).array().exp().max(1e-12);
  Ellipsoid out;
  Eigen::Matrix4d world_from_box = Eigen::Matrix4d::Identity();
  world_from_box.block<3, 3>(0, 0) = turn.toRotationMatrix();
  world_from_box.block<3, 1>(0, 3) = vector_at(g.means, i);
  out.camera_from_box = camera_from_world * world_from_box;
  out.size = 2 * radii;
  out.to_ball = radii.cwiseInverse().asDiagonal() * out.camera_from_box.block<3, 3>(0, 0).transpose();
  out.colour = (0.5 + kSphericalFirst * vector_at(g.sh_first, i).array()).max(0).min(1);
  return out;
}

/// Draws into the pixels where it is nearer than what they show.
void draw(const Ellipsoid& shape, const PixelBox& box, const std::vector<float>& directions, Picture& picture) {
  const Eigen::Vector3d mean = shape.camera_from_box.block<3, 1>(0, 3), centre = shape.to_ball * mean;
  const double beyond = centre.squaredNorm() - 1;  // > 0: the camera is outside
  for (int y = box.top; y < box.bottom; ++y)
    for (int x = box.left; x < box.right; ++x) {
      const auto pixel =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(picture.width) + static_cast<std::size_t>(x);
      // The nearer root of |t ray - centre| = 1, in the space where the surface is the unit sphere.
      const Eigen::Vector3d way = vector_at(directions, pixel).normalized(), ray = shape.to_ball * way;
      const double a = ray.squaredNorm(), b = ray.dot(centre), root = b * b - a * beyond;
      if (root < 0 || b <= 0) continue;
      const double t = (b - std::sqrt(root)) / a;
      if (picture.depth[pixel] > 0 && t >= static_cast<double>(picture.depth[pixel])) continue;
      const Eigen::Vector3d normal = (shape.to_ball.transpose() * (t * ray - centre)).normalized();
      const Eigen::Vector3d seen = shape.colour * (kAmbient + (1 - kAmbient) * std::abs(normal.dot(way)));
      picture.depth[pixel] = static_cast<float>(t);
      picture.opacity[pixel] = 1;
      for (int c = 0; c < 3; ++c) picture.rgb[3 * pixel + static_cast<std::size_t>(c)] = static_cast<float>(seen[c]);
    }
}

}  // namespace

Picture ellipsoid_picture(const Gaussians& gaussians, const View& view, const EllipsoidOptions& options) {
  const std::size_t pixels = static_cast<std::size_t>(view.camera.width) * static_cast<std::size_t>(view.camera.height);
  Picture picture{view.camera.width,
                  view.camera.height,
                  std::vector<float>(3 * pixels, static_cast<float>(options.background)),
                  std::vector<float>(pixels, 0.f),
                  std::vector<float>(pixels, 0.f),
                  {}};
  const std::vector<float> directions = pixel_directions(view.camera);
  const Eigen::Matrix4d camera_from_world = view.world_from_camera.inverse();
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    if (i % kBetween == kBetween - 1) view.between();
    if (sigmoid(static_cast<double>(gaussians.opacities[i])) < options.least_opacity) continue;
    const Ellipsoid shape = ellipsoid_of(gaussians, i, camera_from_world, options.deviations);
    const Eigen::Vector3d mean = shape.camera_from_box.block<3, 1>(0, 3);
    if (mean.z() < options.near || (shape.to_ball * mean).squaredNorm() <= 1) continue;
    if (const auto box = bounds_in_image(view.camera, shape.camera_from_box, shape.size))
      draw(shape, *box, directions, picture);
  }
  return picture;
}

}  // namespace cloam
