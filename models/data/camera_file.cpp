// See camera_file.h.
#include "models/data/camera_file.h"

#include <nlohmann/json.hpp>

#include "models/data/poses.h"
#include "models/data/transforms_json.h"
#include "models/io/json.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr double kLargestSide = 1 << 14;

Camera camera_of(const Json& json, const std::string& where) {
  for (const char* side : {"w", "h"}) {
    const double value = number(json, side, where);
    if (value >= 1 && value <= kLargestSide) continue;
    bad_data(where, ": \"", side, "\" is ", value, ", want 1 to ", kLargestSide);
  }
  return read_camera_json(json, json, {}, where);
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
  bad_data(where, ": \"log\" is ", log.dump().substr(0, 60), ", want the name or number of one of ", logs.names.size(),
           " logs");
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
  if (views.empty()) bad_data(where + ": \"frames\" is empty");
  return views;
}

}  // namespace cloam
