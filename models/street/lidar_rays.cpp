// See lidar_rays.h.
#include "models/street/lidar_rays.h"

#include <algorithm>
#include <cmath>

namespace cloam {
namespace {

constexpr std::size_t kMaxRays = 20000;
constexpr double kNearest = 1e-3;  // metres; a return in the LiDAR itself has no direction

}  // namespace

SweepRays sweep_rays(const Sweep& sweep, const LidarPoints& points, int scene) {
  SweepRays out;
  out.rays.scene = scene;
  out.rays.time = sweep.timestamp;
  const bool turning = std::count(points.sensors.begin(), points.sensors.end(), 0) > 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (turning && points.sensors[i] != 0 && !sweep.second_lidar) continue;
    const auto [origin, time] = seen_from(sweep, points, i);
    const Eigen::Vector3d way =
        Eigen::Vector3f(points.positions[3 * i], points.positions[3 * i + 1], points.positions[3 * i + 2])
            .cast<double>() -
        origin;
    if (way.norm() < kNearest) continue;
    out.depths.push_back(static_cast<float>(way.norm()));
    if (sweep.velocity) out.rays.times.push_back(time);
    for (int axis = 0; axis < 3; ++axis) {
      out.rays.origins.push_back(static_cast<float>(origin[axis]));
      out.rays.directions.push_back(static_cast<float>(way[axis] / way.norm()));
    }
  }
  return out;
}

SweepRays thinned(const SweepRays& rays, std::size_t most) {
  const std::size_t stride = std::max<std::size_t>(1, (rays.depths.size() + most - 1) / most);
  SweepRays out;
  out.rays.scene = rays.rays.scene;
  out.rays.time = rays.rays.time;
  for (std::size_t i = 0; i < rays.depths.size(); i += stride) {
    out.depths.push_back(rays.depths[i]);
    if (!rays.rays.times.empty()) out.rays.times.push_back(rays.rays.times[i]);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      out.rays.origins.push_back(rays.rays.origins[3 * i + axis]);
      out.rays.directions.push_back(rays.rays.directions[3 * i + axis]);
    }
  }
  return out;
}

std::optional<MeasuredSweep> measured_sweep(Street& street, const Scene& scene, const Sweep& sweep, int index) {
  SweepRays rays = thinned(sweep_rays(sweep, load_sweep(scene, sweep), index), kMaxRays);
  if (rays.depths.empty()) return {};
  std::vector<float> depths = street.measure(rays.rays).depths;
  return MeasuredSweep{std::move(rays), std::move(depths)};
}

}  // namespace cloam
