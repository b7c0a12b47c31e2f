// Changes to the actors of a run's scenes: what `cloam edit` asks for.
#pragma once
#include <variant>
#include <vector>

#include "models/scene/assets.h"

namespace cloam {

/// Along the axes of the actor's box (x right, y forward, z up) as it stands at each moment.
struct Shift {
  Eigen::Vector3d metres = Eigen::Vector3d::Zero();
};

/// Counter-clockwise about the box's own z axis, seen from above.
struct Turn {
  double radians = 0;
};

/// The actor stays in the list, without boxes: methods keep what they learnt for each actor by its place there.
struct Remove {};

/// The actor takes an appearance and the size that belongs to them, and stands on the same ground. Its label stays its
/// own: what it looks like is labelled by whoever the appearance belongs to.
struct Replace {
  AssetName appearance;
  Eigen::Vector3d size = Eigen::Vector3d::Zero();
};

/// Where the centre of a box is in the log's world, z up; yaw 0 looks along +y, counter-clockwise.
struct PathPoint {
  double time = 0;  // seconds on the log's clock
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  double yaw = 0;  // radians
};

/// The actor has boxes at the steps within the path's times, linearly between its points (yaw the shorter way round). A
/// path of one point is a place to stand at all the time.
struct Follow {
  std::vector<PathPoint> path;  // by time
};

/// By another actor as it is in `scenes`.
Replace replace_by(const Scenes& scenes, const AssetName& other);

using ActorEdit = std::variant<Shift, Turn, Remove, Replace, Follow>;

/// Applies one edit to one actor. Edits compose: each sees what those before it left. Fault::usage for moving an actor
/// without boxes, and for a path that is empty, not in order of time, or outside the log's time.
void apply(const ActorEdit& edit, Scenes& scenes, const AssetName& actor);

/// A moment of a log.
struct Moment {
  int step = 0;
  double timestamp = 0;
};

/// One a step, in order: when its sweep is, else its first image.
std::vector<Moment> moments_of(const Scene& scene);

/// Whether the actor is anywhere else, or has another appearance or size, than in another version of its log.
bool differs(const Actor& a, const Actor& b);

}  // namespace cloam
