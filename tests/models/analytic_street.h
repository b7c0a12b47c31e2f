// A street whose answers are known in closed form: the ground z = 0, a wall at y = 30, and actors that fill their
// boxes.
#pragma once
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "models/scene/assets.h"
#include "models/street/has_surfaces.h"
#include "models/street/street.h"

namespace cloam {

/// Size of the box that the looks fill, in metres: that of any actor who has them. (The actor who had them first may
/// have another's by now.) Nothing if nobody has them.
inline std::optional<Eigen::Vector3d> size_of_appearance(const Scenes& scenes, const AssetName& appearance) {
  for (int scene = 0; scene < static_cast<int>(scenes.size()); ++scene) {
    for (const Actor& actor : scenes[static_cast<std::size_t>(scene)].actors) {
      if (actor.asset.value_or(AssetName{scene, actor.id}) == appearance) return actor.size;
    }
  }
  return std::nullopt;
}

class AnalyticStreet : public Street, public HasSurfaces {
 public:
  explicit AnalyticStreet(Scenes scenes) : scenes_(std::move(scenes)) {}

  /// More background: the depth along a ray (infinite: missed), and whom the street takes it for.
  std::function<double(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction)> ghost;

  int ghost_owner = 0;
  double sunk = 0;  // metres behind the front of their boxes where actors begin

  LidarReturns measure(const WorldRays& rays) override {
    LidarReturns returns;
    const auto& actors = scenes_.at(static_cast<std::size_t>(rays.scene)).actors;
    for (std::size_t r = 0; r < rays.origins.size(); r += 3) {
      const Eigen::Vector3d o(rays.origins[r], rays.origins[r + 1], rays.origins[r + 2]);
      const Eigen::Vector3d d(rays.directions[r], rays.directions[r + 1], rays.directions[r + 2]);
      double depth = background(o, d);
      int seen = 0;
      for (std::size_t a = 0; a < actors.size(); ++a) {
        const auto pose = world_from_box_at(actors[a], rays.times.empty() ? rays.time : rays.times[r / 3]);
        const double at = pose ? box_depth(pose->inverse(), actors[a].size, o, d) + sunk : kMissed;
        if (at < depth) depth = at, seen = static_cast<int>(a) + 1;
      }
      if (ghost && ghost(o, d) <= depth) seen = ghost_owner;
      returns.depths.push_back(depth < kMissed ? static_cast<float>(depth) : 0.f);
      returns.actors.push_back(seen);
    }
    return returns;
  }

  Picture render_asset(const AssetName& asset, const Camera& camera, const Eigen::Matrix4d& box_from_camera) override {
    Picture picture{camera.width, camera.height, {}, {}, {}, {}};
    const Eigen::Vector3d size = size_of_appearance(scenes_, asset).value();
    const std::vector<float> directions = pixel_directions(camera);
    for (std::size_t i = 0; i < directions.size(); i += 3) {
      const Eigen::Vector3d d(directions[i], directions[i + 1], directions[i + 2]);
      const double depth = box_depth(Eigen::Matrix4d::Identity(), size, box_from_camera.topRightCorner<3, 1>(),
                                     box_from_camera.topLeftCorner<3, 3>() * d.normalized());
      const float grey = depth < kMissed ? 0.25f : 1.f;
      picture.rgb.insert(picture.rgb.end(), {grey, grey, grey});
      picture.depth.push_back(depth < kMissed ? static_cast<float>(depth) : 0.f);
      picture.opacity.push_back(depth < kMissed);
    }
    return picture;
  }

  /// The exact distance to the box; red to its right, green to its left.
  AssetSamples sample_asset(const AssetName& asset, const std::vector<float>& points) override {
    AssetSamples samples;
    const Eigen::Vector3d half = 0.5 * size_of_appearance(scenes_, asset).value();
    for (std::size_t i = 0; i < points.size(); i += 3) {
      const Eigen::Vector3d p(points[i], points[i + 1], points[i + 2]), q = p.cwiseAbs() - half;
      const double distance = q.cwiseMax(0.).norm() + std::min(q.maxCoeff(), 0.);
      samples.distances.push_back(static_cast<float>(distance));
      samples.colours.insert(samples.colours.end(), {p.x() > 0 ? 1.f : 0.f, p.x() > 0 ? 0.f : 1.f, 0.f});
    }
    return samples;
  }


 private:
  static constexpr double kMissed = std::numeric_limits<double>::infinity();

  double background(const Eigen::Vector3d& o, const Eigen::Vector3d& d) const {
    double depth = kMissed;
    if (d.z() < 0) depth = std::min(depth, std::max(0., -o.z() / d.z()));
    if (d.y() > 0 && o.y() < 30) depth = std::min(depth, (30 - o.y()) / d.y());
    return ghost ? std::min(depth, ghost(o, d)) : depth;
  }

  static double box_depth(const Eigen::Matrix4d& box_from_world, const Eigen::Vector3d& size, const Eigen::Vector3d& o,
                          const Eigen::Vector3d& d) {
    const Eigen::Vector3d from = (box_from_world * o.homogeneous()).head<3>();
    const Eigen::Vector3d along = box_from_world.topLeftCorner<3, 3>() * d;
    double enter = 0, leave = kMissed;
    for (int axis = 0; axis < 3; ++axis) {
      const double a = (-size[axis] / 2 - from[axis]) / along[axis], b = (size[axis] / 2 - from[axis]) / along[axis];
      enter = std::max(enter, std::min(a, b));
      leave = std::min(leave, std::max(a, b));
    }
    return enter < leave ? enter : kMissed;
  }

  Scenes scenes_;
};

}  // namespace cloam
