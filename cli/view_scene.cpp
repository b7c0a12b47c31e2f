// See view_scene.h.
#include "cli/view_scene.h"

#include <algorithm>

#include "models/io/words.h"
#include "models/scene/camera_path.h"
#include "models/scene/orbit.h"
#include "models/scene/split.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;
using Eigen::Vector3d;

constexpr double kAhead = 15, kAround = 20;  // metres, in a street

double quantile(std::vector<double> values, double share) {
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

/// What all kinds of scenes have; the rest is filled in by whoever knows more.
Report begin_scene(const std::string& title, const char* kind, const std::string& method) {
  return {{"schema_version", 1},
          {"title", title},
          {"kind", kind},
          {"method", method.empty() ? Report() : Report(method)},
          {"up", Report::array({0, 0, 1})},
          {"centre", Report::array({0, 0, 0})},
          {"radius", 1},
          {"background", "#000000"},
          {"splats", nullptr},
          {"cameras", Report::array()},
          {"times", nullptr},
          {"street", false},
          {"lidar", false},
          {"training", nullptr},
          {"revision", 0},
          {"can_undo", false},
          {"can_save", false}};
}

const char* word_for(CameraModel model) {
  return model == CameraModel::pinhole   ? "pinhole"
         : model == CameraModel::opencv  ? "opencv"
         : model == CameraModel::fisheye ? "fisheye"
                                         : "fov";
}

Report camera_json(const Scene& scene, std::size_t place, int downscale) {
  const Frame& frame = scene.frames[place];
  const Camera camera = scaled(scene.cameras[static_cast<std::size_t>(frame.camera)], downscale);
  return {{"name", frame.name},
          {"sensor", frame.sensor},
          {"width", camera.width},
          {"height", camera.height},
          {"fx", camera.fx},
          {"fy", camera.fy},
          {"cx", camera.cx},
          {"cy", camera.cy},
          {"lens", word_for(camera.model)},
          {"world_from_camera", pose_json(frame.world_from_camera)},
          {"time", frame.timestamp ? Report(*frame.timestamp) : Report()},
          {"photo", text("photos/", place)}};
}

/// A street is looked at from where the recording car began; photos around what they show.
void place_page(const Scene& scene, Report& json) {
  json["up"] = vector_json(scene.is_log ? scene.up : mean_up(scene));
  if (scene.is_log) {
    const std::vector<Frame> frames = frames_in_order(scene, front_sensor(scene));
    const Frame& first = frames.empty() ? scene.frames.front() : frames.front();
    json["centre"] = vector_json(first.position() + kAhead * first.world_from_camera.block<3, 1>(0, 2));
    json["radius"] = kAround;
    return;
  }
  const Vector3d centre = looked_at(scene);
  std::vector<double> distances;
  for (const Frame& frame : scene.frames) distances.push_back((frame.position() - centre).norm());
  json["centre"] = vector_json(centre);
  json["radius"] = std::max(1e-6, quantile(std::move(distances), 0.5));
}

Report times_of(const Scene& scene) {
  std::vector<double> times;
  for (const Frame& frame : scene.frames)
    if (frame.timestamp) times.push_back(*frame.timestamp);
  if (!scene.is_log || times.empty()) return nullptr;
  const auto [first, last] = std::minmax_element(times.begin(), times.end());
  return Report::array({*first, *last});
}

}  // namespace

Report vector_json(const Vector3d& v) { return Report::array({v.x(), v.y(), v.z()}); }

Report pose_json(const Eigen::Matrix4d& pose) {
  Report numbers = Report::array();
  for (int i = 0; i < 12; ++i) numbers.push_back(pose(i / 4, i % 4));
  return numbers;
}

Report scene_of_gaussians(const std::string& title, const Gaussians& gaussians) {
  Report json = begin_scene(title, "gaussians", "");
  std::vector<double> along[3], distances;
  for (std::size_t i = 0; i < gaussians.means.size(); ++i)
    along[i % 3].push_back(static_cast<double>(gaussians.means[i]));
  const Vector3d centre(quantile(along[0], 0.5), quantile(along[1], 0.5), quantile(along[2], 0.5));
  for (std::size_t g = 0; g < gaussians.count(); ++g)
    distances.push_back((Eigen::Map<const Eigen::Vector3f>(&gaussians.means[3 * g]).cast<double>() - centre).norm());
  json["up"] = vector_json(gaussians.up);
  json["centre"] = vector_json(centre);
  json["radius"] = std::max(1e-6, quantile(std::move(distances), 0.9));
  json["splats"] = "splats.ply";
  return json;
}

Report scene_of_captures(const std::string& title, const std::string& method, const Scene& scene, int downscale) {
  Report json = begin_scene(title, "rendered", method);
  place_page(scene, json);
  for (std::size_t i = 0; i < scene.frames.size(); ++i) json["cameras"].push_back(camera_json(scene, i, downscale));
  json["times"] = times_of(scene);
  json["lidar"] = !scene.sweeps.empty();
  return json;
}

}  // namespace cloam
