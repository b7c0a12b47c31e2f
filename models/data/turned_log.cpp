// See turned_log.h.
#include "models/data/turned_log.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "models/io/paths.h"
#include "models/scene/actor_space.h"
#include "models/scene/pose.h"
#include "models/scene/split.h"

namespace cloam {

namespace fs = std::filesystem;

namespace {

/// "truth/rot045/front_camera/07.jpg", relative to the root; as recorded, the frame's own.
std::string turned_image(const std::string& front, const Frame& frame, int degrees) {
  if (degrees == 0) return frame.image;
  return fmt::format("truth/rot{:03}/{}/{}", degrees, front, fs::path(frame.image).filename().generic_string());
}

/// Of any angle but 0.
bool has_turned_image(const Scene& log, const Frame& frame) {
  const std::string front = front_sensor(log);
  for (int degrees = kTurnStep; degrees < kFullTurn; degrees += kTurnStep)
    if (frame.sensor == front && is_file(log.root / turned_image(front, frame, degrees))) return true;
  return false;
}

}  // namespace

void turn_actors(Scene& scene, double degrees) {
  const Eigen::Matrix4d turn = pose_from(turn_about_z(degrees * M_PI / 180), Eigen::Vector3d::Zero());
  for (Actor& actor : scene.actors)
    for (ActorBox& box : actor.boxes) box.world_from_box = (box.world_from_box * turn).eval();
}

bool has_turned_truth(const Scene& log) {
  return std::any_of(log.frames.begin(), log.frames.end(),
                     [&](const Frame& frame) { return has_turned_image(log, frame); });
}

TurnedLog turned_log(const Scene& log, int degrees) {
  TurnedLog turned{log, degrees, has_turned_truth(log)};
  const std::string front = front_sensor(log);
  turn_actors(turned.scene, degrees);
  for (Frame& frame : turned.scene.frames) {
    const Eigen::Vector3d camera = frame.world_from_camera.topRightCorner<3, 1>();
    const bool swallowed = ActorSpace(turned.scene, frame.timestamp.value_or(0)).holds(camera);
    const bool possible = frame.sensor == front && !swallowed;
    turned.possible += possible;
    const bool known = !turned.has_truth || degrees != 0 || has_turned_image(log, frame);
    if (turned.has_truth) frame.image = turned_image(front, frame, degrees);
    const bool measured = possible && known && (!turned.has_truth || has_file(log.root / frame.image));
    frame.split = measured ? Split::test : Split::unused;
  }
  return turned;
}

}  // namespace cloam
