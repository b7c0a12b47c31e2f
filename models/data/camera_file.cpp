// See camera_file.h.
#include "models/data/camera_file.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "models/data/poses.h"
#include "models/io/json.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr double kLargestSide = 1 << 14;

double side(const Json& json, const char* key, const std::string& where) {
  const double value = number(json, key, where);
  if (value < 1 || value > kLargestSide)
    throw Error(Fault::data, text(where, ": \"", key, "\" is ", value, ", want 1 to ", kLargestSide));
  return value;
}

double focal(const Json& json, double width, const std::string& where) {
  const auto length = optional_number(json, "fl_x", where), angle = optional_number(json, "camera_angle_x", where);
  if (!length && !angle) throw Error(Fault::data, where + ": want \"fl_x\" (pixels) or \"camera_angle_x\" (radians)");
  const double value = length ? *length : 0.5 * width / std::tan(0.5 * *angle);
  if (!(value > 0)) throw Error(Fault::data, text(where, ": the focal length is ", value, ", want a number above 0"));
  return value;
}

Camera camera_of(const Json& json, const std::string& where) {
  Camera camera;
  camera.width = static_cast<int>(side(json, "w", where));
  camera.height = static_cast<int>(side(json, "h", where));
  camera.fx = focal(json, camera.width, where);
  camera.fy = optional_number(json, "fl_y", where).value_or(camera.fx);
  camera.cx = optional_number(json, "cx", where).value_or(0.5 * camera.width);
  camera.cy = optional_number(json, "cy", where).value_or(0.5 * camera.height);
  camera.k[0] = optional_number(json, "k1", where).value_or(0);
  camera.k[1] = optional_number(json, "k2", where).value_or(0);
  camera.p1 = optional_number(json, "p1", where).value_or(0);
  camera.p2 = optional_number(json, "p2", where).value_or(0);
  const bool straight = camera.k[0] == 0 && camera.k[1] == 0 && camera.p1 == 0 && camera.p2 == 0;
  camera.model = straight ? CameraModel::pinhole : CameraModel::opencv;
  return camera;
}

struct Logs {
  const std::vector<std::string>& names;
  int without = 0;
};

int log_of(const Json& json, const Logs& logs, const std::string& where) {
  if (!json.contains("log")) return logs.without;
  const Json& log = json["log"];
  for (std::size_t i = 0; i < logs.names.size(); ++i)
    if (log == Json(logs.names[i]) || log == Json(i)) return static_cast<int>(i);
  throw Error(Fault::data, text(where, ": \"log\" is ", log.dump().substr(0, 60),
                                ", want the name or number of one of ", logs.names.size(), " logs"));
}

View view_of(const Json& json, const Logs& logs, const std::string& where) {
  const Eigen::Matrix4d pose = opencv_from_opengl_pose(matrix4(json, "transform_matrix", where));
  return {camera_of(json, where), rigid(pose, where), log_of(json, logs, where),
          optional_number(json, "time", where).value_or(0)};
}

}  // namespace

std::vector<View> read_camera_file(const std::filesystem::path& path, const std::vector<std::string>& names, int log) {
  const Logs logs{names, log};
  const Json file = parse_json_file(path);
  const std::string where = path.string();
  if (!file.is_object() || !file.contains("frames")) return {view_of(file, logs, where)};
  Json shared = file;
  shared.erase("frames");
  std::vector<View> views;
  for (const Json& frame : array(file, "frames", where)) {
    Json merged = shared;
    if (frame.is_object()) merged.update(frame);
    views.push_back(view_of(merged, logs, text(where, ", frame ", views.size())));
  }
  if (views.empty()) throw Error(Fault::data, where + ": \"frames\" is empty");
  return views;
}

}  // namespace cloam
