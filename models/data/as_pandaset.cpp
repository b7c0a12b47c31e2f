// See as_pandaset.h.
#include "models/data/as_pandaset.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

#include "models/data/pandaset.h"
#include "models/scene/edit.h"
#include "models/scene/split.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr double kSamePixels = 1e-3;  // that lenses may differ by and be one
constexpr double kSameSeconds = 1e-6;

/// Where PandaSet's cameras look, in degrees to the left of the front.
struct Direction {
  const char* camera;
  double degrees;
};
constexpr Direction kDirections[] = {{"front_camera", 0},  {"front_left_camera", 55}, {"front_right_camera", -55},
                                     {"left_camera", 110}, {"right_camera", -110},    {"back_camera", 180}};

/// Degrees to the left in which a camera looks, of the world.
double heading(const Frame& frame) {
  return std::atan2(frame.world_from_camera(1, 2), frame.world_from_camera(0, 2)) * 180 / M_PI;
}

/// Degrees to the left of `front` in which a camera looks, at the first step that both have.
double degrees_from(const std::string& front, const std::string& sensor, const Scene& log) {
  std::map<int, double> ahead;
  for (const Frame& frame : log.frames)
    if (frame.sensor == front) ahead[frame.step] = heading(frame);
  for (const Frame& frame : log.frames)
    if (frame.sensor == sensor && ahead.contains(frame.step)) return heading(frame) - ahead[frame.step];
  return 0;
}

/// PandaSet's name by a camera's own: front_camera for the one that looks ahead, its own where it is one of PandaSet's,
/// else those that are left, of the nearest directions first.
std::map<std::string, std::string> pandaset_names(const Scene& log) {
  const std::vector<std::string> sensors = sensors_of(log);
  if (sensors.size() > std::size(kPandasetCameras))
    throw Error(Fault::usage, text("PandaSet's layout has six cameras, the log has ", sensors.size(),
                                   "\n  fix: --cameras of simulate chooses some; else train on a copy without some"));
  const std::string front = front_sensor(log);
  std::map<std::string, std::string> names = {{front, kPandasetCameras[0]}};
  std::set<std::string> taken = {kPandasetCameras[0]};
  for (const std::string& sensor : sensors)
    if (std::find(std::begin(kPandasetCameras), std::end(kPandasetCameras), sensor) != std::end(kPandasetCameras) &&
        taken.insert(sensor).second)
      names[sensor] = sensor;
  std::vector<std::tuple<double, std::string, std::string>> ways;  // degrees apart, the camera's name, PandaSet's
  for (const std::string& sensor : sensors)
    for (const Direction& direction : kDirections)
      ways.emplace_back(std::abs(std::remainder(degrees_from(front, sensor, log) - direction.degrees, 360)), sensor,
                        direction.camera);
  std::sort(ways.begin(), ways.end());
  for (const auto& [apart, sensor, name] : ways)
    if (!names.contains(sensor) && taken.insert(name).second) names[sensor] = name;
  return names;
}

/// Fault::usage where a camera has several lenses, sizes of its photos apart.
void require_one_lens_each(const Scene& log) {
  std::map<std::string, Camera> lenses;
  for (const Frame& frame : log.frames) {
    const Camera& camera = log.cameras.at(static_cast<std::size_t>(frame.camera));
    const Camera& first = lenses.emplace(frame.sensor, camera).first->second;
    const Camera same = resized(first, camera.width, camera.height);
    const double apart = std::max({std::abs(same.fx - camera.fx), std::abs(same.fy - camera.fy),
                                   std::abs(same.cx - camera.cx), std::abs(same.cy - camera.cy)});
    if (apart > kSamePixels)
      throw Error(Fault::usage, text("PandaSet's layout has one lens for each camera; photos of ", frame.sensor,
                                     " have several, as ", frame.name, " shows"));
  }
}

/// A reader gives boxes the time of their step: they are to be where the actor is then.
void move_boxes_to_their_steps(Scene& log) {
  if (log.recording.sweep_seconds > 0) return;  // it finds when the LiDAR passed them
  const std::vector<Moment> moments = moments_of(log);
  for (Actor& actor : log.actors) {
    const Actor given = actor;
    for (const Moment& moment : moments)
      for (ActorBox& box : actor.boxes)
        if (box.step == moment.step && std::abs(box.timestamp - moment.timestamp) > kSameSeconds)
          box = {box.step, moment.timestamp, *world_from_box_of_step(given, box.step, moment.timestamp)};
  }
}

}  // namespace

PandasetLog as_pandaset(const Scene& log, const std::vector<Camera>& pinholes) {
  const std::map<std::string, std::string> names = pandaset_names(log);
  PandasetLog out{log, {}};
  out.scene.cameras.clear();
  for (Frame& frame : out.scene.frames) {
    frame.camera = find_or_add(out.scene.cameras, pinholes.at(static_cast<std::size_t>(frame.camera)));
    frame.sensor = names.at(frame.sensor);
  }
  require_one_lens_each(out.scene);
  move_boxes_to_their_steps(out.scene);
  Recording& recording = out.scene.recording;
  recording.sweep_stamp = recording.image_stamp = 0;
  recording.lidar_poses_wrong = false;
  recording.poses_replaced = 0;
  for (const auto& [sensor, name] : names)
    if (sensor != name) out.renamed[sensor] = name;
  return out;
}

}  // namespace cloam
