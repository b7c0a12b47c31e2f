// See lidar_rays.h.
#include "models/street/lidar_rays.h"

#include <algorithm>
#include <cmath>

#include "models/street/missing_rays.h"

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
    out.intensities.push_back(points.intensities[i]);
    if (sweep.velocity) out.rays.times.push_back(time);
    for (int axis = 0; axis < 3; ++axis) {
      out.rays.origins.push_back(static_cast<float>(origin[axis]));
      out.rays.directions.push_back(static_cast<float>(way[axis] / way.norm()));
    }
  }
  return out;
}

WorldRays every(const WorldRays& rays, std::size_t stride) {
  WorldRays out;
  out.scene = rays.scene;
  out.time = rays.time;
  for (std::size_t i = 0; 3 * i < rays.origins.size(); i += stride) {
    if (!rays.times.empty()) out.times.push_back(rays.times[i]);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      out.origins.push_back(rays.origins[3 * i + axis]);
      out.directions.push_back(rays.directions[3 * i + axis]);
    }
  }
  return out;
}

namespace {

std::size_t stride_for(std::size_t rays, std::size_t most) {
  return std::max<std::size_t>(1, (rays + most - 1) / most);
}

}  // namespace

SweepRays thinned(const SweepRays& rays, std::size_t most) {
  const std::size_t stride = stride_for(rays.depths.size(), most);
  SweepRays out{every(rays.rays, stride), {}, {}};
  for (std::size_t i = 0; i < rays.depths.size(); i += stride) {
    out.depths.push_back(rays.depths[i]);
    if (!rays.intensities.empty()) out.intensities.push_back(rays.intensities[i]);
  }
  return out;
}

std::optional<MeasuredSweep> measured_sweep(Street& street, const Scene& scene, const Sweep& sweep, int index) {
  const LidarPoints points = load_sweep(scene, sweep);
  const SweepRays all = sweep_rays(sweep, points, index);
  if (all.depths.empty()) return {};
  SweepRays rays = thinned(all, kMaxRays);
  LidarReturns seen = street.measure(rays.rays);
  MeasuredSweep out{std::move(rays), std::move(seen.depths), std::move(seen.intensities), std::move(seen.drops), {}};
  if (out.drops.empty()) return out;
  const WorldRays missing =
      every(missing_rays(scene.recording, sweep, points, index), stride_for(all.depths.size(), kMaxRays));
  if (!missing.origins.empty()) out.missing_drops = street.measure(missing).drops;
  return out;
}

}  // namespace cloam
