// See nuscenes.h. Rows of the tables name each other by tokens; only what belongs to the scene is kept. Frames of axes:
// ego x forward, y left, z up; LiDAR x right, y forward, z up; cameras x right, y down, z forward.
#include "models/data/nuscenes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "models/data/log_builder.h"
#include "models/data/moments.h"
#include "models/data/poses.h"
#include "models/io/json.h"
#include "models/io/paths.h"
#include "models/io/safetensors_header.h"  // printable
#include "models/io/words.h"
#include "models/scene/pose.h"
#include "runtime/nearest_name.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr const char* kLidar = "LIDAR_TOP";
constexpr double kMicrosecond = 1e-6;
constexpr std::size_t kListedNames = 10;

/// The folders of tables in a root, by name.
std::vector<fs::path> versions_in(const fs::path& root) {
  std::vector<fs::path> found;
  for (const fs::path& entry : entries_of(root))
    if (entry.filename().string().starts_with("v1.0-") && is_file(entry / "scene.json") &&
        is_file(entry / "sample_data.json"))
      found.push_back(entry);
  return found;
}

/// One row of a table, and where it stands in words.
struct Row {
  const Json& json;
  std::string where;

  std::string word(const char* key) const { return string(json, key, where); }
  double number(const char* key) const { return cloam::number(json, key, where); }
  double seconds() const { return kMicrosecond * number("timestamp"); }
  std::vector<double> numbers(const char* key, std::size_t count) const {
    std::vector<double> values;
    for (const Json& value : array(json, key, where)) values.push_back(value.is_number() ? value.get<double>() : NAN);
    const bool finite = std::all_of(values.begin(), values.end(), [](double value) { return std::isfinite(value); });
    if (values.size() != count || !finite) bad_data(where, ": ", key, " is not a list of ", count, " finite numbers");
    return values;
  }
  /// Of `rotation`, a quaternion w x y z, and `translation`.
  Eigen::Matrix4d pose() const {
    const std::vector<double> q = numbers("rotation", 4), t = numbers("translation", 3);
    const Eigen::Quaterniond turn(q[0], q[1], q[2], q[3]);
    if (std::abs(turn.norm() - 1) > 0.01)
      bad_data(where, ": the quaternion rotation has the length ", turn.norm(), ", want 1");
    return pose_from(turn.normalized().toRotationMatrix(), {t[0], t[1], t[2]});
  }
};

/// The tables of one version.
class Tables {
 public:
  explicit Tables(const fs::path& folder) : folder_(folder) {}

  /// use(row) for each, in the order of the file.
  template <class Use>
  void for_each(const std::string& table, const Use& use) const {
    const std::string file = name_of(table);
    if (!has_file(folder_ / (table + ".json")))
      bad_data((folder_ / (table + ".json")).string(), " is missing; unpack all of the metadata's archive");
    for_each_in_json_file(folder_ / (table + ".json"), [&](const Json& json, std::size_t number) {
      use(Row{json, text(file, ", row ", number)});
    });
  }

  std::string name_of(const std::string& table) const { return folder_.filename().string() + "/" + table + ".json"; }

  /// What a row names by a token in another table.
  template <class Value>
  const Value& named(const std::map<std::string, Value>& of, const Row& row, const char* key,
                     const std::string& table) const {
    const auto found = of.find(row.word(key));
    if (found == of.end())
      bad_data(row.where, ": ", key, " is ", printable(row.word(key)), ", which ", name_of(table),
               " has no row for; unpack the metadata's archive again");
    return found->second;
  }

 private:
  fs::path folder_;
};

/// The scene to read.
struct SceneRow {
  std::string token, name;
  bool night = false;
};

/// All versions' scenes, with the tables they stand in.
std::vector<std::pair<fs::path, SceneRow>> scenes_in(const fs::path& root) {
  std::vector<std::pair<fs::path, SceneRow>> found;
  for (const fs::path& folder : versions_in(root))
    Tables(folder).for_each("scene", [&](const Row& row) {
      const std::string description = lower_case(optional_string(row.json, "description", row.where).value_or(""));
      found.push_back(
          {folder, {row.word("token"), printable(row.word("name")), description.find("night") != std::string::npos}});
    });
  return found;
}

std::pair<fs::path, SceneRow> scene_named(const fs::path& root, const std::string& name) {
  const auto all = scenes_in(root);
  std::vector<std::string> names;
  for (const auto& [folder, scene] : all) {
    if (scene.name == name || (name.empty() && all.size() == 1)) return {folder, scene};
    names.push_back(scene.name);
  }
  if (!name.empty()) bad_data(root.string(), ": has no scene ", printable(name), did_you_mean(name, names));
  std::string listed;
  for (std::size_t i = 0; i < std::min(kListedNames, names.size()); ++i) listed += "\n  " + (root / names[i]).string();
  bad_data(root.string(), ": holds ", names.size(),
           " scenes, want one; give one of them as if it were a folder:", listed,
           names.size() > kListedNames ? "\n  ..." : "");
}

// Their x points forward and y to the left; here y does and x points right.
Eigen::Matrix4d box_pose(const Eigen::Matrix4d& given) {
  const Eigen::Matrix3d turn{{0, 1, 0}, {-1, 0, 0}, {0, 0, 1}};
  return given * pose_from(turn, Eigen::Vector3d::Zero());
}

class NuscenesReader {
 public:
  NuscenesReader(const fs::path& root, const fs::path& folder, SceneRow scene, const ReadOptions& options)
      : tables_(folder), row_(std::move(scene)), options_(options), log_(root, "nuScenes", options) {}

  Scene read() {
    scene_.night = row_.night;
    scene_.part = row_.name;
    read_samples();
    read_sensors();
    read_files();
    read_poses();
    place_origin();
    add_sweeps();
    add_frames();
    add_boxes();
    return log_.finish(
        {"samples/CAM_* and sweeps/CAM_*", "samples/LIDAR_TOP and sweeps/LIDAR_TOP", "sample_annotation.json"});
  }

 private:
  struct Sensor {
    std::string channel;
    bool is_camera = false;
    Eigen::Matrix4d ego_from_sensor;
    std::vector<double> intrinsics;  // 3x3 by rows; of a camera
    std::string where;
  };
  /// A row of sample_data.
  struct File {
    std::string name, ego_pose, where;
    const Sensor* sensor;
    double time;
    int width, height;
    Eigen::Matrix4d world_from_sensor = Eigen::Matrix4d::Identity();
  };

  void read_samples() {
    tables_.for_each("sample", [&](const Row& row) {
      if (row.word("scene_token") == row_.token) samples_.emplace(row.word("token"), row.seconds());
    });
    if (samples_.empty()) bad_data(tables_.name_of("sample"), ": has no row of the scene ", row_.name);
  }

  void read_sensors() {
    std::map<std::string, std::pair<std::string, bool>> kinds;
    tables_.for_each("sensor", [&](const Row& row) {
      kinds.emplace(row.word("token"), std::pair(printable(row.word("channel")), row.word("modality") == "camera"));
    });
    tables_.for_each("calibrated_sensor", [&](const Row& row) {
      const auto& [channel, is_camera] = tables_.named(kinds, row, "sensor_token", "sensor");
      Sensor sensor{channel, is_camera, rigid(row.pose(), row.where), {}, row.where};
      if (is_camera) sensor.intrinsics = intrinsics_of(row);
      sensors_.emplace(row.word("token"), std::move(sensor));
    });
  }

  static std::vector<double> intrinsics_of(const Row& row) {
    const Json& rows = array(row.json, "camera_intrinsic", row.where);
    std::vector<double> values;
    for (const Json& line : rows)
      for (std::size_t i = 0; line.is_array() && i < line.size(); ++i)
        values.push_back(line[i].is_number() ? line[i].get<double>() : NAN);
    const bool finite = std::all_of(values.begin(), values.end(), [](double value) { return std::isfinite(value); });
    if (rows.size() != 3 || values.size() != 9 || !finite || values[1] != 0 || values[3] != 0)
      bad_data(row.where, ": camera_intrinsic is not fx 0 cx, 0 fy cy, 0 0 1");
    return values;
  }

  void read_files() {
    tables_.for_each("sample_data", [&](const Row& row) {
      if (!samples_.contains(row.word("sample_token"))) return;
      const Sensor& sensor = tables_.named(sensors_, row, "calibrated_sensor_token", "calibrated_sensor");
      if (!sensor.is_camera && sensor.channel != kLidar) return;
      const bool camera = sensor.is_camera;
      files_.push_back({path_named(scene_.root, row.word("filename"), options_.allow_outside),
                        row.word("ego_pose_token"), row.where, &sensor, row.seconds(),
                        camera ? image_side(row.number("width"), "width", row.where) : 0,
                        camera ? image_side(row.number("height"), "height", row.where) : 0});
    });
    if (files_.empty()) bad_data(tables_.name_of("sample_data"), ": has no row of the scene ", row_.name);
    std::stable_sort(files_.begin(), files_.end(), [](const File& a, const File& b) { return a.time < b.time; });
  }

  void read_poses() {
    std::set<std::string> wanted;
    for (const File& file : files_) wanted.insert(file.ego_pose);
    std::map<std::string, Eigen::Matrix4d> poses;
    tables_.for_each("ego_pose", [&](const Row& row) {
      if (wanted.contains(row.word("token"))) poses.emplace(row.word("token"), rigid(row.pose(), row.where));
    });
    for (File& file : files_) {
      const auto found = poses.find(file.ego_pose);
      if (found == poses.end())
        bad_data(file.where, ": ego_pose_token is ", printable(file.ego_pose), ", which ", tables_.name_of("ego_pose"),
                 " has no row for; unpack the metadata's archive again");
      file.world_from_sensor = found->second * file.sensor->ego_from_sensor;
    }
  }

  /// Maps count from a corner of a town: float32 would blur that far away.
  void place_origin() {
    origin_ =
        (files_.front().world_from_sensor * files_.front().sensor->ego_from_sensor.inverse()).topRightCorner<3, 1>();
    for (File& file : files_) {
      file.world_from_sensor.topRightCorner<3, 1>() -= origin_;
      if (file.world_from_sensor.topRightCorner<3, 1>().norm() > kFarthestOfLog)
        bad_data(file.where, ": its ego pose is more than ", kFarthestOfLog, " m away from the first one");
    }
  }

  void add_sweeps() {
    std::vector<double> times;
    for (const File& file : files_) {
      if (file.sensor->is_camera) continue;
      if (!has_file(scene_.root / file.name)) {
        log_.missing(file.name);
        continue;
      }
      if (!times.empty() && times.back() == file.time)
        bad_data(file.where, ": another sweep of ", kLidar, " has its timestamp; unpack the metadata's archive again");
      const int step = static_cast<int>(times.size());
      scene_.sweeps.push_back({file.name, file.time, file.world_from_sensor, step, Split::train, false});
      times.push_back(file.time);
    }
    if (times.empty())  // then the key frames count
      for (const auto& [token, time] : samples_) times.push_back(time);
    std::sort(times.begin(), times.end());
    times_ = times;
    moments_ = Moments(std::move(times));
  }

  void add_frames() {
    std::vector<Frame> found;
    for (const File& file : files_) {
      if (!file.sensor->is_camera) continue;
      ++scene_.frames_listed;
      if (!has_file(scene_.root / file.name)) {
        log_.missing(file.name);
        continue;
      }
      log_.guarded("frame", [&] {
        const std::vector<double>& k = file.sensor->intrinsics;
        const Camera camera{file.width, file.height, k[0], k[4], k[2], k[5]};
        require_sound(camera, file.sensor->where);
        Frame frame;
        frame.name = frame.image = file.name;
        frame.sensor = file.sensor->channel;
        frame.timestamp = file.time;
        frame.world_from_camera = file.world_from_sensor;
        frame.camera = find_or_add(scene_.cameras, camera);
        found.push_back(std::move(frame));
      });
    }
    scene_.frames = nearest_frames(found, moments_);
  }

  /// What people drew, by instance, in key frames.
  std::map<std::string, Actor> drawn_boxes() {
    std::map<std::string, Actor> actors;
    tables_.for_each("sample_annotation", [&](const Row& row) {
      const auto sample = samples_.find(row.word("sample_token"));
      if (sample == samples_.end()) return;
      log_.guarded("box", [&] {
        Actor& actor = actors[row.word("instance_token")];
        actor.id = printable(row.word("instance_token"));
        const std::vector<double> size = row.numbers("size", 3);  // width, length, height
        actor.size = actor.size.cwiseMax(Eigen::Vector3d(size[0], size[1], size[2]));
        Eigen::Matrix4d pose = box_pose(rigid(row.pose(), row.where));
        pose.topRightCorner<3, 1>() -= origin_;
        actor.boxes.push_back({0, sample->second, pose});
      });
    });
    return actors;
  }

  void name_categories(std::map<std::string, Actor>& actors) {
    std::map<std::string, std::string> categories;
    tables_.for_each("category", [&](const Row& row) { categories.emplace(row.word("token"), row.word("name")); });
    tables_.for_each("instance", [&](const Row& row) {
      const auto actor = actors.find(row.word("token"));
      if (actor != actors.end())
        actor->second.label = printable(tables_.named(categories, row, "category_token", "category"));
    });
    for (const auto& [token, actor] : actors)
      if (actor.label.empty())
        bad_data(tables_.name_of("sample_annotation"), ": instance_token is ", actor.id, ", which ",
                 tables_.name_of("instance"), " has no row for; unpack the metadata's archive again");
  }

  void add_boxes() {
    std::map<std::string, Actor> actors = drawn_boxes();
    name_categories(actors);
    for (auto& [token, actor] : actors) {
      std::stable_sort(actor.boxes.begin(), actor.boxes.end(),
                       [](const ActorBox& a, const ActorBox& b) { return a.timestamp < b.timestamp; });
      for (std::size_t i = 0; i < actor.boxes.size(); ++i) actor.boxes[i].step = static_cast<int>(i);
      for (std::size_t step = 0; step < times_.size(); ++step)
        if (const auto pose = world_from_box_at(actor, times_[step]))
          log_.add({actor.id, actor.label, actor.size, false, {static_cast<int>(step), times_[step], *pose}},
                   text(tables_.name_of("sample_annotation"), ", instance ", actor.id));
    }
  }

  Tables tables_;
  SceneRow row_;
  ReadOptions options_;
  LogBuilder log_;
  Scene& scene_ = log_.scene;
  std::map<std::string, double> samples_;  // seconds, by token
  std::map<std::string, Sensor> sensors_;  // by token of the calibration
  std::vector<File> files_;                // by time
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  std::vector<double> times_;  // of steps
  Moments moments_;
};

}  // namespace

bool is_nuscenes(const fs::path& root) { return !versions_in(root).empty(); }

Scene read_nuscenes_scene(const fs::path& root, const std::string& name, const ReadOptions& options) {
  const auto [folder, scene] = scene_named(root, name);
  return NuscenesReader(root, folder, scene, options).read();
}

Scene read_nuscenes(const fs::path& root, const ReadOptions& options) { return read_nuscenes_scene(root, "", options); }

}  // namespace cloam
