// See recording_file.h.
#include "models/data/recording_file.h"

#include <Eigen/Geometry>
#include <nlohmann/json.hpp>

#include "models/data/poses.h"
#include "models/io/safetensors_header.h"  // printable
#include "models/scene/pose.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr double kLongest = 1;        // seconds of a sweep, an exposure, or between them and their stamps
constexpr double kFarthestPart = 20;  // metres between sensors, and along the car

const std::pair<const char*, double Recording::*> kSeconds[] = {{"sweep_seconds", &Recording::sweep_seconds},
                                                                {"sweep_stamp_after_middle", &Recording::sweep_stamp},
                                                                {"image_stamp_after_middle", &Recording::image_stamp},
                                                                {"rolling_shutter_seconds", &Recording::shutter}};

Json to_json(const Vector3d& v) { return {v.x(), v.y(), v.z()}; }

Vector3d place_from(const Json& object, const char* key, const std::string& where) {
  const Json& list = array(object, key, where);
  Vector3d v;
  for (std::size_t i = 0; i < 3; ++i) {
    const bool sound = list.size() == 3 && list[i].is_number() && std::abs(list[i].get<double>()) <= kFarthestPart;
    if (!sound) bad_data(where, ": \"", key, "\": looked for three numbers, each at most ", kFarthestPart);
    v[static_cast<Eigen::Index>(i)] = list[i].get<double>();
  }
  return v;
}

double seconds_from(const Json& json, const char* key, const std::string& where) {
  const double value = optional_number(json, key, where).value_or(0);
  if (std::abs(value) <= kLongest) return value;
  bad_data(where, ": \"", key, "\" is ", value, ", looked for seconds, at most ", kLongest);
}

std::map<std::string, double> rows_from(const Json& json, const std::string& where) {
  if (!json.is_object()) bad_data(where, ": \"car_rows\": looked for {\"CAMERA\": SHARE, ...}");
  std::map<std::string, double> rows;
  for (const auto& [camera, value] : json.items()) {
    const double share = value.is_number() ? value.get<double>() : -1;
    if (!(share >= 0 && share < 1))
      bad_data(where, ": \"car_rows\" of ", printable(camera), ": looked for a share of the rows, 0 to 1");
    rows[camera] = share;
  }
  return rows;
}

}  // namespace

Json to_json(const Recording& r) {
  const Recording plain;
  Json json = Json::object();
  for (const auto& [key, member] : kSeconds)
    if (r.*member != plain.*member) json[key] = r.*member;
  if (r.ahead != plain.ahead) json["ahead"] = to_json(r.ahead);
  if (r.front_from_lidar) {
    Json rows = Json::array();
    for (int row = 0; row < 4; ++row) {
      const Eigen::RowVector4d numbers = r.front_from_lidar->row(row);
      rows.push_back(std::vector<double>(numbers.data(), numbers.data() + 4));
    }
    json["front_camera_from_lidar"] = rows;
  }
  if (r.lidar_poses_wrong) json["lidar_poses_wrong"] = true;
  if (r.second_lidar) json["second_lidar"] = to_json(*r.second_lidar);
  if (r.car) json["car"] = {{"centre", to_json(r.car->centre)}, {"size", to_json(r.car->size)}};
  if (!r.car_rows.empty()) json["car_rows"] = r.car_rows;
  if (r.poses_replaced > 0) json["poses_replaced"] = r.poses_replaced;
  return json;
}

Recording recording_from(const Json& json, const std::string& where) {
  if (!json.is_object()) bad_data(where, ": looked for an object, found ", json.type_name());
  Recording r;
  for (const auto& [key, member] : kSeconds) r.*member = seconds_from(json, key, where);
  if (r.sweep_seconds < 0 || r.shutter < 0) bad_data(where, ": a sweep or an exposure of less than 0 seconds");
  if (json.contains("ahead")) r.ahead = place_from(json, "ahead", where);
  if (!(r.ahead.head<2>().norm() > 1e-3)) bad_data(where, ": \"ahead\" has no direction along the ground");
  if (json.contains("front_camera_from_lidar"))
    r.front_from_lidar = rigid(matrix4(json, "front_camera_from_lidar", where), where);
  r.lidar_poses_wrong = flag(json, "lidar_poses_wrong", false, where);
  if (json.contains("second_lidar")) r.second_lidar = place_from(json, "second_lidar", where);
  if (json.contains("car")) {
    const Json& car = json["car"];
    r.car = {place_from(car, "centre", where), place_from(car, "size", where)};
    if (!(r.car->size.minCoeff() > 0)) bad_data(where, ": the car's box has no size");
  }
  if (json.contains("car_rows")) r.car_rows = rows_from(json["car_rows"], where);
  r.poses_replaced = static_cast<std::size_t>(std::max(0., optional_number(json, "poses_replaced", where).value_or(0)));
  return r;
}

// The published static calibration maps axes of the LiDAR (x to the left, y to the rear, z up) to those of each sensor.
// What NeuRAD's reader does: lidar/poses.json is wrong, the front camera's pose and the middle of a sweep go together;
// images have the time of their last rows.
Recording pandaset_recording() {
  Recording r;
  r.sweep_seconds = 0.1;
  r.sweep_stamp = 0.05;
  r.image_stamp = 0.01;
  r.shutter = 0.03;
  r.ahead = -Vector3d::UnitY();
  const Eigen::Quaterniond front(0.016213200031258722, 0.0030578899383849464, 0.7114721800418571, -0.7025205466606356);
  r.front_from_lidar = pose_from(front.normalized().toRotationMatrix(),
                                 {0.0002585796504896516, -0.03907777167811011, -0.0440125762408362});
  r.lidar_poses_wrong = true;
  const Eigen::Quaterniond second(0.021475754959146356, -0.002060907279494794, 0.01134678181520767, 0.9997028534282365);
  r.second_lidar = -(second.normalized().conjugate() * Vector3d(-0.000451117754, -0.605646431446, -0.301525235176));
  r.car = {{0, 0, -0.9}, {2.3, 5.2, 2.2}};  // the LiDAR stands on the middle of the roof
  r.car_rows = {{"back_camera", 260.0 / 1080}};
  return r;
}

}  // namespace cloam
