// See pandaset.h.
#include "models/data/pandaset.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "models/data/data_frame.h"
#include "models/data/log_builder.h"
#include "models/data/poses.h"
#include "models/io/image.h"
#include "models/io/json.h"
#include "models/io/paths.h"
#include "models/io/safetensors_header.h"  // printable
#include "models/scene/edit.h"
#include "models/scene/pose.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxSteps = 100000;

// The real car's static calibration (front camera from LiDAR), and the focal length that its front camera is known by.
// NeuRAD found the published lidar/poses.json to be wrong and takes the LiDAR's pose from the front camera's in this
// way.
constexpr double kRealFrontFocal = 1970.0131;
constexpr double kEgoRows = 260.0 / 1080;  // of its back camera, which sees the car's own boot
const Eigen::Quaterniond kFrontFromLidar(0.016213200031258722, 0.0030578899383849464, 0.7114721800418571,
                                         -0.7025205466606356);
const Eigen::Vector3d kFrontFromLidarOrigin(0.0002585796504896516, -0.03907777167811011, -0.0440125762408362);

// The paper's list, for logs that do not say it themselves.
const std::set<std::string> kNightLogs = {"057", "058", "059", "062", "063", "064", "065", "066", "067", "068",
                                          "069", "070", "071", "072", "073", "074", "077", "078", "079", "149"};

// The first of several spellings of a file that exists, relative to the root.
std::string find_file(const fs::path& root, const std::string& stem, std::initializer_list<const char*> extensions) {
  for (const char* extension : extensions) {
    if (has_file(root / (stem + extension))) return stem + extension;
  }
  return "";
}

Json read_json(const fs::path& root, const std::string& name) { return parse_json_file(root / name); }

const Json& entries(const Json& json, const std::string& where) {
  if (json.is_array() && json.size() <= kMaxSteps) return json;
  bad_data(where, ": looked for a list of at most ", kMaxSteps, " entries, found ",
           json.is_array() ? text(json.size()) : std::string(json.type_name()));
}

// {"position": {x, y, z}, "heading": {w, x, y, z}}: world from sensor.
Eigen::Matrix4d read_pose(const Json& json, const std::string& where) {
  const Json &position = member(json, "position", where), &heading = member(json, "heading", where);
  const Eigen::Quaterniond turn(number(heading, "w", where), number(heading, "x", where), number(heading, "y", where),
                                number(heading, "z", where));
  if (!(std::abs(turn.norm() - 1) < 0.01)) bad_data(where, ": the heading has length ", turn.norm(), ", want 1");
  const Eigen::Vector3d place(number(position, "x", where), number(position, "y", where), number(position, "z", where));
  return rigid(pose_from(turn.normalized().toRotationMatrix(), place), where);
}

double read_time(const Json& json, const std::string& where) {
  const double time = json.is_number() ? json.get<double>() : NAN;
  if (!std::isfinite(time)) bad_data(where, ": looked for a time in seconds");
  return time;
}

class LogReader {
 public:
  LogReader(const fs::path& root, const ReadOptions& options) : log_(root, "PandaSet", options) {}

  Scene read() {
    for (const char* name : kPandasetCameras) {
      const std::string folder = text("camera/", name);
      if (has_file(scene_.root / folder / "poses.json")) read_camera(name, folder);
    }
    warn_of_other_cameras();
    if (has_file(scene_.root / "lidar/poses.json")) read_sweeps();
    read_cuboids();
    read_time_of_day();
    return log_.finish({"camera/*/poses.json", "lidar/poses.json", "annotations/cuboids/*.pkl.gz"});
  }

 private:
  void read_camera(const std::string& name, const std::string& folder) {
    const auto poses = read_poses(folder);
    scene_.frames_listed += poses.entries.size();
    int camera = -1;
    for (int step = 0; step < int(poses.entries.size()); ++step) {
      const std::string image = find_file(scene_.root, folder + "/" + pandaset_number(step), {".jpg", ".png", ".jpeg"});
      if (image.empty()) {
        log_.missing(folder + "/" + pandaset_number(step) + ".jpg");
        continue;
      }
      log_.guarded("frame", [&] {
        Frame frame;
        frame.name = frame.image = image;
        frame.sensor = name;
        frame.step = step;
        frame.world_from_camera = poses.pose(step);
        frame.timestamp = poses.time(step);
        if (camera < 0) camera = find_or_add(scene_.cameras, read_intrinsics(folder, image));
        frame.camera = camera;
        if (name == "back_camera" && is_real_car()) frame.ego_rows = kEgoRows;
        scene_.frames.push_back(std::move(frame));
      });
    }
  }

  // Folders of images that are not read.
  void warn_of_other_cameras() {
    for (const fs::path& entry : entries_of(scene_.root / "camera")) {
      std::error_code error;
      if (!fs::is_directory(entry, error)) continue;
      const std::string name = entry.filename().string();
      const bool known =
          std::find(std::begin(kPandasetCameras), std::end(kPandasetCameras), name) != std::end(kPandasetCameras);
      if (known && is_file(scene_.root / "camera" / name / "poses.json")) continue;
      scene_.warnings.push_back(text("camera/", printable(name), " is left out: ",
                                     known ? "it has no poses.json" : "PandaSet has no camera of that name"));
    }
  }

  // PandaSet states no size: the first image has it.
  Camera read_intrinsics(const std::string& folder, const std::string& image) const {
    const std::string where = folder + "/intrinsics.json";
    const Json json = read_json(scene_.root, where);
    const ImageSize size = read_image_size(scene_.root / image);
    Camera camera;
    camera.width = size.width;
    camera.height = size.height;
    camera.fx = number(json, "fx", where);
    camera.fy = number(json, "fy", where);
    camera.cx = number(json, "cx", where);
    camera.cy = number(json, "cy", where);
    require_sound(camera, where);
    return camera;
  }

  // The poses and times of one sensor, each looked at when it is asked for.
  struct Poses {
    std::string where;
    Json entries, times;

    std::string place(int step) const { return text(where, "/poses.json, entry ", step); }
    Eigen::Matrix4d pose(int step) const { return read_pose(entries[std::size_t(step)], place(step)); }
    double time(int step) const {
      return read_time(times[std::size_t(step)], text(where, "/timestamps.json, entry ", step));
    }
  };

  Poses read_poses(const std::string& folder) const {
    Poses poses{folder, read_json(scene_.root, folder + "/poses.json"),
                read_json(scene_.root, folder + "/timestamps.json")};
    const std::size_t count = entries(poses.entries, folder + "/poses.json").size(),
                      times = entries(poses.times, folder + "/timestamps.json").size();
    if (count == times) return poses;
    bad_data(folder, ": ", count, " poses but ", times, " time stamps");
  }

  void read_sweeps() {
    const auto poses = read_poses("lidar");
    for (int step = 0; step < int(poses.entries.size()); ++step) {
      const std::string file = find_file(scene_.root, "lidar/" + pandaset_number(step), {".pkl.gz", ".pkl"});
      if (file.empty()) {
        log_.missing("lidar/" + pandaset_number(step) + ".pkl.gz");
        continue;
      }
      log_.guarded("sweep", [&] {
        scene_.sweeps.push_back({file, poses.time(step), sensor_pose(poses, step), step, Split::train});
      });
    }
  }

  bool is_of_real_car(const Frame& front) const {
    return front.sensor == kPandasetCameras[0] &&
           std::abs(scene_.cameras[std::size_t(front.camera)].fx - kRealFrontFocal) < 0.01;
  }
  bool is_real_car() const {
    return std::any_of(scene_.frames.begin(), scene_.frames.end(),
                       [&](const Frame& frame) { return is_of_real_car(frame); });
  }

  Eigen::Matrix4d sensor_pose(const Poses& poses, int step) const {
    const auto front = std::find_if(scene_.frames.begin(), scene_.frames.end(),
                                    [&](const Frame& frame) { return frame.step == step && is_of_real_car(frame); });
    if (front == scene_.frames.end()) return poses.pose(step);
    return front->world_from_camera * pose_from(kFrontFromLidar.normalized().toRotationMatrix(), kFrontFromLidarOrigin);
  }

  void read_cuboids() {
    std::error_code error;
    if (!fs::is_directory(scene_.root / "annotations/cuboids", error)) return;
    // Cuboids are labelled on sweeps; without LiDAR the first camera's times must do.
    for (const auto& [step, time] : moments_of(scene_)) {
      const std::string stem = "annotations/cuboids/" + pandaset_number(step);
      const std::string file = find_file(scene_.root, stem, {".pkl.gz", ".pkl"});
      if (file.empty()) {
        log_.missing(stem + ".pkl.gz");
        continue;
      }
      log_.guarded("cuboids", [&] { read_cuboids_of(file, step, time); });
    }
  }

  void read_cuboids_of(const std::string& file, int step, double time) {
    const DataFrame frame = read_data_frame(scene_.root / file);
    if (frame.rows() == 0) return;
    const auto &ids = frame.texts("uuid"), &labels = frame.texts("label");
    const auto yaws = frame.numbers("yaw"), x = frame.numbers("position.x"), y = frame.numbers("position.y"),
               z = frame.numbers("position.z"), width = frame.numbers("dimensions.x"),
               length = frame.numbers("dimensions.y"), height = frame.numbers("dimensions.z");
    const auto stationary =
        frame.has("stationary") ? frame.numbers("stationary") : std::vector<double>(frame.rows(), 0);
    // What both LiDARs saw has a box from each; sensor 1 is the one that looks ahead.
    const auto sensors =
        frame.has("cuboids.sensor_id") ? frame.numbers("cuboids.sensor_id") : std::vector<double>(frame.rows(), -1);
    for (std::size_t row = 0; row < frame.rows(); ++row) {
      if (sensors[row] == 1) continue;
      const Eigen::Vector3d size(width[row], length[row], height[row]);
      // Yaw 0 looks along the world's y, as the box's own axes do.
      const Eigen::Matrix4d pose = pose_from(turn_about_z(yaws[row]), {x[row], y[row], z[row]});
      const std::string where = text(file, ", row ", row, " (", printable(ids[row]), ")");
      log_.add({ids[row], labels[row], size, stationary[row] != 0, {step, time, pose}}, where);
    }
  }

  void read_time_of_day() {
    const std::string file = "meta/time_of_day.json";
    scene_.night = kNightLogs.contains(scene_.root.filename().string());
    if (has_file(scene_.root / file)) { scene_.night = flag(read_json(scene_.root, file), "night", false, file); }
  }

  LogBuilder log_;
  Scene& scene_ = log_.scene;
};

}  // namespace

std::string pandaset_number(int step) { return fmt::format("{:02}", step); }

bool is_pandaset(const fs::path& root) {
  if (is_file(root / "lidar" / "poses.json")) return true;
  return std::any_of(std::begin(kPandasetCameras), std::end(kPandasetCameras),
                     [&](const char* name) { return is_file(root / "camera" / name / "poses.json"); });
}

Scene read_pandaset(const fs::path& root, const ReadOptions& options) { return LogReader(root, options).read(); }

}  // namespace cloam
