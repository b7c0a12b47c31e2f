// The space that actors take up at a time.
#pragma once
#include <map>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// Metres that an actor's space reaches beyond its box, along its axes: room for wheels and mirrors.
const Eigen::Vector3d kActorRoom(0.2, 0.2, 0.1);

/// The boxes of actors, with room around them.
class ActorSpace {
 public:
  ActorSpace() = default;  // nobody is there
  /// Of all actors that have a box at `time`, but for those that `without` marks (by place in scene.actors; empty:
  /// none). room: less than 0 for smaller boxes.
  ActorSpace(const Scene& scene, double time, const std::vector<bool>& without = {},
             const Eigen::Vector3d& room = kActorRoom);
  /// world: a point in the scene's world frame. A sweep asks for each of its points: only boxes that are near along one
  /// axis are looked at.
  bool holds(const Eigen::Vector3d& world) const;
  /// Whether a box stands between two points of the world. One in which either point lies does not count.
  bool stands_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) const;

 private:
  struct Box {
    Eigen::Matrix4d box_from_world;
    Eigen::Vector3d half, centre;  // of its axes; in the world
  };
  std::vector<Box> boxes_;  // by their centres along axis_
  Eigen::Index axis_ = 0;   // of the world, along which they lie furthest apart
  double reach_ = 0;        // of the largest, from its centre
};

/// The spaces of moments that are asked for more than once, as those of a sweep are.
class ActorSpaces {
 public:
  /// `scene` must outlive this; `without` and `room` as above.
  explicit ActorSpaces(const Scene& scene, std::vector<bool> without = {}, const Eigen::Vector3d& room = kActorRoom)
      : scene_(scene), without_(std::move(without)), room_(room) {}
  const ActorSpace& at(double time) {
    const auto found = spaces_.find(time);
    return found != spaces_.end() ? found->second
                                  : spaces_.emplace(time, ActorSpace(scene_, time, without_, room_)).first->second;
  }

 private:
  const Scene& scene_;
  std::vector<bool> without_;
  Eigen::Vector3d room_;
  std::map<double, ActorSpace> spaces_;
};

}  // namespace cloam
