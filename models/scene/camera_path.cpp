// See camera_path.h.
#include "models/scene/camera_path.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "models/scene/pose.h"

namespace cloam {
namespace {

using Eigen::Vector3d;

Eigen::Quaterniond rotation(const Frame& frame) {
  return Eigen::Quaterniond(Eigen::Matrix3d(frame.world_from_camera.topLeftCorner<3, 3>())).normalized();
}

/// Catmull and Rom 1974: the mean of the steps before and after, here not longer than three times the shorter one.
/// Up to there a cubic does not turn back on its way (Fritsch and Carlson 1980), which it would between two photos that
/// are close together and far from the others.
Vector3d velocity(const std::vector<Frame>& stops, std::size_t at) {
  const auto step_to = [&](std::size_t i) -> Vector3d { return stops[i].position() - stops[i - 1].position(); };
  const Vector3d before = step_to(std::max<std::size_t>(at, 1)), after = step_to(std::min(at + 1, stops.size() - 1));
  const Vector3d mean = (before + after) / 2;
  const double most = 3 * std::min(before.norm(), after.norm());
  return mean.norm() > most ? mean * (most / mean.norm()) : mean;
}

/// The cubic with the positions and velocities of the stops `from` and `from + 1` (Hermite), at a share of the way.
Vector3d position_between(const std::vector<Frame>& stops, std::size_t from, double share) {
  const double t = share, rest = 1 - share;
  return rest * rest * (1 + 2 * t) * stops[from].position() + t * t * (1 + 2 * rest) * stops[from + 1].position() +
         t * rest * rest * velocity(stops, from) - t * t * rest * velocity(stops, from + 1);
}

CameraMoment moment_between(const std::vector<Frame>& stops, std::size_t from, double share) {
  const Frame &a = stops[from], &b = stops[from + 1];
  return {pose_from(rotation(a).slerp(share, rotation(b)).toRotationMatrix(), position_between(stops, from, share)),
          (1 - share) * a.timestamp.value_or(0) + share * b.timestamp.value_or(0)};
}

}  // namespace

std::vector<Frame> frames_in_order(const Scene& scene, const std::string& sensor) {
  std::vector<Frame> frames;
  for (const Frame& frame : scene.frames)
    if (frame.sensor == sensor) frames.push_back(frame);
  std::stable_sort(frames.begin(), frames.end(), [](const Frame& a, const Frame& b) {
    return a.step != b.step ? a.step < b.step : strverscmp(a.image.c_str(), b.image.c_str()) < 0;
  });
  return frames;
}

std::vector<CameraMoment> interpolated_path(const std::vector<Frame>& stops, int count) {
  std::vector<CameraMoment> moments;
  for (int i = 0; i < count; ++i) {
    if (stops.size() == 1) {
      moments.push_back({stops[0].world_from_camera, stops[0].timestamp.value_or(0)});
      continue;
    }
    const double place = static_cast<double>(stops.size() - 1) * i / std::max(count - 1, 1);
    const std::size_t from = std::min(static_cast<std::size_t>(place), stops.size() - 2);
    moments.push_back(moment_between(stops, from, place - static_cast<double>(from)));
  }
  return moments;
}

}  // namespace cloam
