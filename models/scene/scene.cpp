// See scene.h.
#include "models/scene/scene.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "models/scene/pose.h"

namespace cloam {
namespace {

constexpr double kAloneSeconds = 0.1;     // of the moments of a log that usual LiDARs make
constexpr double kAcrossSeam = 2.1;       // usual distances between boxes of successive steps, of a LiDAR that turns
constexpr double kStill = 1;              // metres from its first box: who stays nearer goes nowhere
constexpr double kMomentSeconds = 0.005;  // of returns that count as seen at once: 5 cm at 10 m/s

/// The distance in time of boxes, which gaps only make longer. Where a LiDAR turns, boxes that cross the seam of its
/// sweeps are seen twice in a moment, or not for two turns; the former do not count.
double usual_distance(const std::vector<ActorBox>& boxes) {
  if (boxes.size() == 1) return kAloneSeconds;
  const int steps = boxes.back().step - boxes.front().step;
  const double a_step = steps > 0 ? (boxes.back().timestamp - boxes.front().timestamp) / steps : 0;
  double usual = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < boxes.size(); ++i) {
    const double gap = boxes[i].timestamp - boxes[i - 1].timestamp;
    if (gap >= 0.5 * a_step * (boxes[i].step - boxes[i - 1].step)) usual = std::min(usual, gap);
  }
  return usual;
}

}  // namespace

SeenFrom seen_from(const Sweep& sweep, int sensor, double seconds_after) {
  SeenFrom from{sweep.world_from_lidar.topRightCorner<3, 1>(), sweep.timestamp};
  if (sensor == 1 && sweep.second_lidar)
    from.origin += sweep.world_from_lidar.topLeftCorner<3, 3>() * *sweep.second_lidar;
  if (!sweep.velocity) return from;
  from.origin += seconds_after * *sweep.velocity;
  from.time += kMomentSeconds * std::round(seconds_after / kMomentSeconds);
  return from;
}

std::vector<std::size_t> frames_of(const Scene& scene, Split split) {
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < scene.frames.size(); ++i) {
    if (scene.frames[i].split == split) indices.push_back(i);
  }
  return indices;
}

std::optional<Eigen::Matrix4d> world_from_box_at(const Actor& actor, double time) {
  const std::vector<ActorBox>& boxes = actor.boxes;
  if (boxes.empty()) return std::nullopt;
  const double usual = usual_distance(boxes);
  const auto next = std::lower_bound(boxes.begin(), boxes.end(), time,
                                     [](const ActorBox& box, double t) { return box.timestamp < t; });
  if (next == boxes.begin() || next == boxes.end()) {
    const ActorBox& nearest = next == boxes.end() ? boxes.back() : boxes.front();
    if (std::abs(nearest.timestamp - time) > 0.5 * usual) return std::nullopt;
    return nearest.world_from_box;
  }
  const ActorBox& before = *(next - 1);
  const double gap = next->timestamp - before.timestamp, share = (time - before.timestamp) / gap;
  const double longest = next->step - before.step == 1 ? kAcrossSeam : 1.5;
  if (gap > longest * usual && time != next->timestamp) return std::nullopt;
  return pose_between(before.world_from_box, next->world_from_box, share);
}

bool goes_somewhere(const Actor& actor) {
  const auto place = [](const ActorBox& box) -> Eigen::Vector3d { return box.world_from_box.topRightCorner<3, 1>(); };
  return std::any_of(actor.boxes.begin(), actor.boxes.end(),
                     [&](const ActorBox& box) { return (place(box) - place(actor.boxes.front())).norm() > kStill; });
}

const ActorBox* box_at_step(const Actor& actor, int step) {
  const auto found = std::lower_bound(actor.boxes.begin(), actor.boxes.end(), step,
                                      [](const ActorBox& box, int wanted) { return box.step < wanted; });
  return found == actor.boxes.end() || found->step != step ? nullptr : &*found;
}

std::optional<Eigen::Matrix4d> world_from_box_of_step(const Actor& actor, int step, std::optional<double> time) {
  const ActorBox* box = box_at_step(actor, step);
  if (!box) return std::nullopt;
  const auto pose = time ? world_from_box_at(actor, *time) : std::nullopt;
  return pose.value_or(box->world_from_box);
}

Eigen::Vector3d mean_up(const Scene& scene) {
  Eigen::Vector3d up = Eigen::Vector3d::Zero();
  for (const Frame& frame : scene.frames) up -= frame.world_from_camera.block<3, 1>(0, 1);
  return up.norm() > 0.1 * static_cast<double>(scene.frames.size()) ? up.normalized() : scene.up.normalized();
}

int find_or_add(std::vector<Camera>& cameras, const Camera& camera) {
  const auto found = std::find(cameras.begin(), cameras.end(), camera);
  if (found != cameras.end()) return static_cast<int>(found - cameras.begin());
  cameras.push_back(camera);
  return static_cast<int>(cameras.size()) - 1;
}

}  // namespace cloam
