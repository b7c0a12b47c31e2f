// See edit.h.
#include "models/scene/edit.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "models/scene/pose.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr double kStanding = 0.1;  // metres: who moves less on a path stands

Matrix4d translation(const Vector3d& metres) { return pose_from(Eigen::Matrix3d::Identity(), metres); }

void move(Actor& actor, const Matrix4d& old_from_new) {
  if (actor.boxes.empty()) {
    throw Error(Fault::usage,
                text("the actor ", actor.id, " has no boxes to move (was it removed?); a path places it"));
  }
  for (ActorBox& box : actor.boxes) box.world_from_box = box.world_from_box * old_from_new;
}

Matrix4d pose_of(const PathPoint& point) { return pose_from(turn_about_z(point.yaw), point.position); }

/// `time` is not before the first point and not after the last.
Matrix4d pose_at(const std::vector<PathPoint>& path, double time) {
  const auto after = std::find_if(path.begin(), path.end(), [&](const PathPoint& p) { return p.time >= time; });
  if (after == path.begin() || after == path.end()) return pose_of(after == path.end() ? path.back() : *after);
  const PathPoint &a = *(after - 1), &b = *after;
  const double share = (time - a.time) / (b.time - a.time);
  const double way = std::remainder(b.yaw - a.yaw, 2 * std::numbers::pi);
  return pose_of({time, a.position + share * (b.position - a.position), a.yaw + share * way});
}

void check(const std::vector<PathPoint>& path) {
  if (path.empty()) throw Error(Fault::usage, "a path without points");
  for (std::size_t i = 1; i < path.size(); ++i) {
    if (path[i].time > path[i - 1].time) continue;
    throw Error(Fault::usage,
                text("a path runs backwards in time: ", path[i].time, " s after ", path[i - 1].time, " s"));
  }
}

void follow(const std::vector<PathPoint>& path, const Scene& scene, Actor& actor) {
  check(path);
  const std::vector<Moment> moments = moments_of(scene);
  const bool stands = path.size() == 1;
  actor.boxes.clear();
  actor.follows_path = true;
  actor.stationary = std::all_of(path.begin(), path.end(), [&](const PathPoint& point) {
    return (point.position - path.front().position).norm() < kStanding;
  });
  for (const Moment& moment : moments) {
    if (!stands && (moment.timestamp < path.front().time || moment.timestamp > path.back().time)) continue;
    actor.boxes.push_back({moment.step, moment.timestamp, pose_at(path, moment.timestamp)});
  }
  if (!actor.boxes.empty() || moments.empty()) return;
  throw Error(Fault::usage,
              text("the path of ", actor.id, " covers no time step of its log: it runs from ",
                   std::to_string(path.front().time), " to ", std::to_string(path.back().time), " s, the log from ",
                   std::to_string(moments.front().timestamp), " to ", std::to_string(moments.back().timestamp), " s"));
}

void replace(const Replace& other, const AssetName& name, Actor& actor) {
  const double rise = 0.5 * (other.size.z() - actor.size.z());
  for (ActorBox& box : actor.boxes) box.world_from_box = box.world_from_box * translation({0, 0, rise});
  actor.size = other.size;
  actor.asset = other.appearance == name ? std::nullopt : std::optional(other.appearance);
}

}  // namespace

Replace replace_by(const Scenes& scenes, const AssetName& other) {
  return {appearance_of(scenes, other), actor_of(scenes, other).size};
}

void apply(const ActorEdit& edit, Scenes& scenes, const AssetName& name) {
  Actor& actor = actor_of(scenes, name);
  if (const auto* shift = std::get_if<Shift>(&edit)) move(actor, translation(shift->metres));
  if (const auto* turned = std::get_if<Turn>(&edit))
    move(actor, pose_from(turn_about_z(turned->radians), Vector3d::Zero()));
  if (std::holds_alternative<Remove>(edit)) actor.boxes.clear();
  if (const auto* other = std::get_if<Replace>(&edit)) replace(*other, name, actor);
  if (const auto* path = std::get_if<Follow>(&edit)) {
    follow(path->path, scenes[static_cast<std::size_t>(name.scene)], actor);
  }
}

std::vector<Moment> moments_of(const Scene& scene) {
  std::map<int, double> times;
  for (const Sweep& sweep : scene.sweeps) times.emplace(sweep.step, sweep.timestamp);
  for (const Frame& frame : scene.frames) {
    if (frame.timestamp) times.emplace(frame.step, *frame.timestamp);
  }
  std::vector<Moment> moments;
  for (const auto& [step, time] : times) moments.push_back({step, time});
  return moments;
}

bool differs(const Actor& a, const Actor& b) {
  const auto same_box = [](const ActorBox& x, const ActorBox& y) {
    return x.step == y.step && x.world_from_box.isApprox(y.world_from_box, 1e-9);
  };
  return a.asset != b.asset || !a.size.isApprox(b.size) ||
         !std::equal(a.boxes.begin(), a.boxes.end(), b.boxes.begin(), b.boxes.end(), same_box);
}

}  // namespace cloam
