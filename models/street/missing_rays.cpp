// See missing_rays.h.
#include "models/street/missing_rays.h"

#include <algorithm>
#include <cmath>

namespace cloam {
namespace {

using Eigen::Vector3d;

constexpr double kDegrees = M_PI / 180;
constexpr double kBetweenBeams = 0.06 * kDegrees;  // at least
constexpr double kWidestBeam = 0.3 * kDegrees;     // what spreads further is several beams
constexpr std::size_t kFewestReturns = 8;
constexpr double kStepsTogether = 1.5;  // a gap from here on has a ray in it

/// A direction of the LiDAR: up, and clockwise from ahead.
struct Direction {
  double elevation, azimuth, seconds;  // seconds: after the sweep's time
};

/// Axes of the LiDAR: right, ahead, up.
Eigen::Matrix3d lidar_axes(const Recording& recording) {
  Eigen::Matrix3d axes;
  axes.row(2) = Vector3d::UnitZ();
  axes.row(1) = (recording.ahead - Vector3d::UnitZ() * recording.ahead.z()).normalized();
  axes.row(0) = Vector3d(axes.row(1)).cross(Vector3d::UnitZ());
  return axes;
}

std::vector<Direction> lidar_directions(const Sweep& sweep, const LidarPoints& points, const Eigen::Matrix3d& axes) {
  const Eigen::Matrix3d turned = axes * sweep.world_from_lidar.topLeftCorner<3, 3>().transpose();
  std::vector<Direction> out;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (points.sensors[i] != 0) continue;
    const Vector3d world = Eigen::Map<const Eigen::Vector3f>(&points.positions[3 * i]).cast<double>();
    const Vector3d way = turned * (world - seen_from(sweep, points, i).origin);
    if (way.norm() < 1e-3) continue;
    out.push_back({std::asin(way.z() / way.norm()), std::atan2(way.x(), way.y()), double{points.times[i]}});
  }
  return out;
}

/// Runs of elevations without a gap.
std::vector<std::vector<Direction>> beams_of(std::vector<Direction> all) {
  std::sort(all.begin(), all.end(), [](const Direction& a, const Direction& b) { return a.elevation < b.elevation; });
  std::vector<std::vector<Direction>> beams;
  for (std::size_t begin = 0, end = 0; begin < all.size(); begin = end) {
    end = begin + 1;
    while (end < all.size() && all[end].elevation - all[end - 1].elevation < kBetweenBeams) ++end;
    const bool is_beam = end - begin >= kFewestReturns && all[end - 1].elevation - all[begin].elevation < kWidestBeam;
    if (!is_beam) continue;
    beams.emplace_back(all.begin() + std::ptrdiff_t(begin), all.begin() + std::ptrdiff_t(end));
    std::sort(beams.back().begin(), beams.back().end(),
              [](const Direction& a, const Direction& b) { return a.azimuth < b.azimuth; });
  }
  return beams;
}

/// The usual angle from a return to the next of its beam; 0 without any.
double usual_step(const std::vector<std::vector<Direction>>& beams) {
  std::vector<double> steps;
  for (const std::vector<Direction>& beam : beams)
    for (std::size_t i = 1; i < beam.size(); ++i) steps.push_back(beam[i].azimuth - beam[i - 1].azimuth);
  if (steps.empty()) return 0;
  const auto middle = steps.begin() + std::ptrdiff_t(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

/// Those between two returns, evenly.
void add_between(const Direction& from, const Direction& to, double step, std::vector<Direction>& out) {
  const double gap = to.azimuth - from.azimuth;
  if (gap < kStepsTogether * step) return;
  const long parts = std::lround(gap / step);
  for (long k = 1; k < parts; ++k) {
    const double share = double(k) / double(parts);
    out.push_back({from.elevation + share * (to.elevation - from.elevation), from.azimuth + share * gap,
                   from.seconds + share * (to.seconds - from.seconds)});
  }
}

/// Those of a beam, from the rear all around to the rear. pace: seconds a radian.
std::vector<Direction> gaps_of(const std::vector<Direction>& beam, double step, double pace) {
  std::vector<Direction> out;
  for (std::size_t i = 1; i < beam.size(); ++i) add_between(beam[i - 1], beam[i], step, out);
  const Direction &first = beam.front(), &last = beam.back();
  for (double by = step; first.azimuth - by > -M_PI; by += step)
    out.push_back({first.elevation, first.azimuth - by, first.seconds - by * pace});
  for (double by = step; last.azimuth + by < M_PI; by += step)
    out.push_back({last.elevation, last.azimuth + by, last.seconds + by * pace});
  return out;
}

/// Whether the recording car stands in the way, seen from the LiDAR, in its axes.
bool meets(const CarBox& car, const Vector3d& way) {
  double enter = 0, leave = 1e9;
  for (int axis = 0; axis < 3; ++axis) {
    const double speed = std::abs(way[axis]) < 1e-9 ? 1e-9 : way[axis];
    const double middle = car.centre[axis] / speed, half = std::abs(0.5 * car.size[axis] / speed);
    enter = std::max(enter, middle - half);
    leave = std::min(leave, middle + half);
  }
  return enter < leave;
}

}  // namespace

WorldRays missing_rays(const Recording& recording, const Sweep& sweep, const LidarPoints& points, int scene) {
  WorldRays rays;
  rays.scene = scene;
  rays.time = sweep.timestamp;
  const Eigen::Matrix3d axes = lidar_axes(recording), world_from_lidar = sweep.world_from_lidar.topLeftCorner<3, 3>();
  const std::vector<std::vector<Direction>> beams = beams_of(lidar_directions(sweep, points, axes));
  const double step = usual_step(beams);
  if (step <= 0) return rays;
  const double pace = sweep.velocity ? recording.sweep_seconds / (2 * M_PI) : 0;
  for (const std::vector<Direction>& beam : beams)
    for (const Direction& gap : gaps_of(beam, step, pace)) {
      const Vector3d way =
          axes.transpose() * Vector3d(std::sin(gap.azimuth) * std::cos(gap.elevation),
                                      std::cos(gap.azimuth) * std::cos(gap.elevation), std::sin(gap.elevation));
      if (recording.car && meets(*recording.car, way)) continue;
      const Vector3d along = world_from_lidar * way;
      const SeenFrom from = seen_from(sweep, 0, sweep.velocity ? gap.seconds : 0);
      for (int axis = 0; axis < 3; ++axis) {
        rays.origins.push_back(static_cast<float>(from.origin[axis]));
        rays.directions.push_back(static_cast<float>(along[axis]));
      }
      if (sweep.velocity) rays.times.push_back(from.time);
    }
  return rays;
}

}  // namespace cloam
