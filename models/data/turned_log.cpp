// See turned_log.h.
#include "models/data/turned_log.h"

#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>

#include "models/scene/actor_space.h"
#include "models/scene/split.h"

namespace cloam {

namespace fs = std::filesystem;

void turn_actors(Scene& scene, double degrees) {
  Eigen::Matrix4d turn = Eigen::Matrix4d::Identity();
  turn.topLeftCorner<3, 3>() = Eigen::AngleAxisd(degrees * M_PI / 180, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  for (Actor& actor : scene.actors)
    for (ActorBox& box : actor.boxes) box.world_from_box = (box.world_from_box * turn).eval();
}

TurnedLog turned_log(const Scene& log, int degrees) {
  TurnedLog turned{log, degrees, false};
  turn_actors(turned.scene, degrees);
  char name[16];
  std::snprintf(name, sizeof name, "rot%03d", degrees);
  const fs::path folder = fs::path("truth") / name / front_sensor(log);
  std::error_code error;
  turned.has_truth = fs::is_directory(log.root / folder, error);
  for (Frame& frame : turned.scene.frames) {
    const Eigen::Vector3d camera = frame.world_from_camera.topRightCorner<3, 1>();
    const bool swallowed = ActorSpace(turned.scene, frame.timestamp.value_or(0)).holds(camera);
    frame.split = frame.sensor == front_sensor(log) && !swallowed ? Split::test : Split::unused;
    if (turned.has_truth) frame.image = (folder / fs::path(frame.image).filename()).generic_string();
  }
  return turned;
}

}  // namespace cloam
