// See turned_log.h.
#include "models/data/turned_log.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "models/scene/split.h"

namespace cloam {

namespace fs = std::filesystem;

void turn_actors(Scene& scene, double degrees) {
  Eigen::Matrix4d turn = Eigen::Matrix4d::Identity();
  turn.topLeftCorner<3, 3>() = Eigen::AngleAxisd(degrees * M_PI / 180, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  for (Actor& actor : scene.actors)
    for (ActorBox& box : actor.boxes) box.world_from_box = (box.world_from_box * turn).eval();
}

namespace {

constexpr double kRoom = 0.25;  // metres around boxes in which a camera counts as inside: they are tight

/// Whether the frame's camera stands inside an actor, as none could.
bool swallowed(const Scene& scene, const Frame& frame) {
  const Eigen::Vector4d camera = frame.world_from_camera.col(3);
  return std::any_of(scene.actors.begin(), scene.actors.end(), [&](const Actor& actor) {
    const auto pose = world_from_box_at(actor, frame.timestamp.value_or(0));
    if (!pose) return false;
    const Eigen::Vector3d in_box = (pose->inverse() * camera).head<3>().cwiseAbs();
    return ((actor.size / 2 - in_box).array() > -kRoom).all();
  });
}

}  // namespace

TurnedLog turned_log(const Scene& log, int degrees) {
  TurnedLog turned{log, degrees, false};
  turn_actors(turned.scene, degrees);
  char name[16];
  std::snprintf(name, sizeof name, "rot%03d", degrees);
  const fs::path folder = fs::path("truth") / name / front_sensor(log);
  std::error_code error;
  turned.has_truth = fs::is_directory(log.root / folder, error);
  for (Frame& frame : turned.scene.frames) {
    const bool measured = frame.sensor == front_sensor(log) && !swallowed(turned.scene, frame);
    frame.split = measured ? Split::test : Split::unused;
    if (turned.has_truth) frame.image = (folder / fs::path(frame.image).filename()).generic_string();
  }
  return turned;
}

}  // namespace cloam
