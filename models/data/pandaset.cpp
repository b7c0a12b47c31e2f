// See pandaset.h.
#include "models/data/pandaset.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "models/data/data_frame.h"
#include "models/data/log_builder.h"
#include "models/data/pose_track.h"
#include "models/data/poses.h"
#include "models/data/recording_file.h"
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

// What the real car's front camera is known by.
constexpr double kRealFrontFocal = 1970.0131;

// LiDAR poses that are further from where the front camera says the LiDAR is are wrong.
constexpr double kWrongMetres = 0.3, kWrongDegrees = 2;

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

bool is_real_car(const fs::path& root) {
  const std::string file = text("camera/", kPandasetCameras[0], "/intrinsics.json");
  if (!has_file(root / file)) return false;
  const Json json = read_json(root, file);
  return json.is_object() && json.contains("fx") && json["fx"].is_number() &&
         std::abs(json["fx"].get<double>() - kRealFrontFocal) < 0.01;
}

Recording read_recording(const fs::path& root) {
  if (has_file(root / kRecordingFile)) return recording_from(read_json(root, kRecordingFile), kRecordingFile);
  return is_real_car(root) ? pandaset_recording() : Recording{};
}

bool are_far(const Eigen::Matrix4d& a, const Eigen::Matrix4d& b) {
  const Eigen::Matrix4d difference = a.inverse() * b;
  const double angle = Eigen::AngleAxisd(Eigen::Matrix3d(difference.topLeftCorner<3, 3>())).angle();
  return difference.topRightCorner<3, 1>().norm() > kWrongMetres || angle > kWrongDegrees * M_PI / 180;
}

class LogReader {
 public:
  LogReader(const fs::path& root, const ReadOptions& options) : log_(root, "PandaSet", options) {}

  Scene read() {
    recording_ = read_recording(scene_.root);
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
    const PoseTrack poses(scene_.root, folder);
    if (name == kPandasetCameras[0]) front_ = poses;
    scene_.frames_listed += std::size_t(poses.steps());
    const auto covered = recording_.car_rows.find(name);
    int camera = -1;
    for (int step = 0; step < poses.steps(); ++step) {
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
        frame.world_from_camera = poses.pose_after(step, -recording_.image_stamp);
        frame.timestamp = poses.time(step) - recording_.image_stamp;
        if (camera < 0) camera = find_or_add(scene_.cameras, read_intrinsics(folder, image));
        frame.camera = camera;
        if (covered != recording_.car_rows.end()) frame.ego_rows = covered->second;
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

  void read_sweeps() {
    const PoseTrack poses(scene_.root, "lidar");
    for (int step = 0; step < poses.steps(); ++step) {
      const std::string file = find_file(scene_.root, "lidar/" + pandaset_number(step), {".pkl.gz", ".pkl"});
      if (file.empty()) {
        log_.missing("lidar/" + pandaset_number(step) + ".pkl.gz");
        continue;
      }
      log_.guarded("sweep", [&] { scene_.sweeps.push_back(sweep_of(poses, step, file)); });
    }
    if (recording_.sweep_seconds > 0) find_velocities();
  }

  // As it stood in the middle of the sweep. Where its pose is wrong, the front camera's takes its place, and time.
  Sweep sweep_of(const PoseTrack& poses, int step, const std::string& file) {
    Sweep sweep{file, poses.time(step) - recording_.sweep_stamp, {}, step, Split::train};
    sweep.second_lidar = recording_.second_lidar;
    const bool known = recording_.front_from_lidar && front_ && step < front_->steps();
    if (known && recording_.lidar_poses_wrong) return with_front_pose(sweep);
    sweep.world_from_lidar = poses.pose_after(step, -recording_.sweep_stamp);
    if (!known) return sweep;
    const Eigen::Matrix4d expected =
        front_->pose_after(step, sweep.timestamp - front_->time(step)) * *recording_.front_from_lidar;
    return are_far(sweep.world_from_lidar, expected) ? with_front_pose(sweep) : sweep;
  }

  Sweep with_front_pose(Sweep sweep) {
    sweep.timestamp = front_->time(sweep.step) - recording_.image_stamp;
    sweep.world_from_lidar = front_->pose_after(sweep.step, -recording_.image_stamp) * *recording_.front_from_lidar;
    ++recording_.poses_replaced;
    return sweep;
  }

  // From the sweeps on either side.
  void find_velocities() {
    std::vector<Sweep>& sweeps = scene_.sweeps;
    for (std::size_t i = 0; i < sweeps.size(); ++i) {
      const Sweep &before = sweeps[i > 0 ? i - 1 : i], &after = sweeps[std::min(i + 1, sweeps.size() - 1)];
      const Eigen::Vector3d way = (after.world_from_lidar - before.world_from_lidar).topRightCorner<3, 1>();
      const double time = after.timestamp - before.timestamp;
      sweeps[i].velocity = way * (time > 0 ? 1 / time : 0);
    }
  }

  // When the LiDAR that turns looked that way; boxes are drawn around its returns.
  double time_of_box(const Sweep& sweep, const Eigen::Vector3d& place) const {
    double after = 0;
    for (int i = 0; i < 2; ++i) {  // it moves on while it turns
      const Eigen::Vector3d way =
          sweep.world_from_lidar.topLeftCorner<3, 3>().transpose() * (place - seen_from(sweep, 0, after).origin);
      const Eigen::Vector3d& ahead = recording_.ahead;
      const double left = std::atan2(ahead.x() * way.y() - ahead.y() * way.x(), ahead.head<2>().dot(way.head<2>()));
      after = -recording_.sweep_seconds * left / (2 * M_PI);
    }
    return sweep.timestamp + after;
  }

  void read_cuboids() {
    std::error_code error;
    if (!fs::is_directory(scene_.root / "annotations/cuboids", error)) return;
    // Cuboids are labelled on sweeps; without LiDAR the first camera's times must do.
    for (const Moment& moment : moments_of(scene_)) {
      const int step = moment.step;
      const std::string stem = "annotations/cuboids/" + pandaset_number(step);
      const std::string file = find_file(scene_.root, stem, {".pkl.gz", ".pkl"});
      if (file.empty()) {
        log_.missing(stem + ".pkl.gz");
        continue;
      }
      log_.guarded("cuboids", [&] { read_cuboids_of(file, moment); });
    }
  }

  void read_cuboids_of(const std::string& file, const Moment& moment) {
    const DataFrame frame = read_data_frame(scene_.root / file);
    if (frame.rows() == 0) return;
    const auto &ids = frame.texts("uuid"), &labels = frame.texts("label");
    const auto yaws = frame.numbers("yaw"), x = frame.numbers("position.x"), y = frame.numbers("position.y"),
               z = frame.numbers("position.z"), width = frame.numbers("dimensions.x"),
               length = frame.numbers("dimensions.y"), height = frame.numbers("dimensions.z");
    const auto stationary =
        frame.has("stationary") ? frame.numbers("stationary") : std::vector<double>(frame.rows(), 0);
    const auto tilts = [&](const char* name) {
      return frame.has(name) ? frame.numbers(name) : std::vector<double>(frame.rows(), 0);
    };
    const std::vector<double> pitches = tilts("pitch"), rolls = tilts("roll");
    // What both LiDARs saw has a box from each; sensor 1 is the one that looks ahead.
    const auto sensors =
        frame.has("cuboids.sensor_id") ? frame.numbers("cuboids.sensor_id") : std::vector<double>(frame.rows(), -1);
    const auto sweep = std::find_if(scene_.sweeps.begin(), scene_.sweeps.end(),
                                    [&](const Sweep& s) { return s.step == moment.step && s.velocity; });
    for (std::size_t row = 0; row < frame.rows(); ++row) {
      if (sensors[row] == 1) continue;
      const Eigen::Vector3d size(width[row], length[row], height[row]);
      // Yaw 0 looks along the world's y, as the box's own axes do.
      const Eigen::Matrix4d pose =
          pose_from(rotation_of({yaws[row], pitches[row], rolls[row]}), {x[row], y[row], z[row]});
      const std::string where = text(file, ", row ", row, " (", printable(ids[row]), ")");
      const double time =
          sweep == scene_.sweeps.end() ? moment.timestamp : time_of_box(*sweep, pose.topRightCorner<3, 1>());
      log_.add({ids[row], labels[row], size, stationary[row] != 0, {moment.step, time, pose}}, where);
    }
  }

  void read_time_of_day() {
    const std::string file = "meta/time_of_day.json";
    scene_.night = kNightLogs.contains(scene_.root.filename().string());
    if (has_file(scene_.root / file)) { scene_.night = flag(read_json(scene_.root, file), "night", false, file); }
  }

  LogBuilder log_;
  Scene& scene_ = log_.scene;
  Recording& recording_ = log_.scene.recording;
  std::optional<PoseTrack> front_;
};

}  // namespace

std::string pandaset_number(int step) { return fmt::format("{:02}", step); }

CuboidTurn cuboid_turn(const Eigen::Matrix4d& box) {
  return {std::atan2(-box(0, 1), box(1, 1)), std::asin(std::clamp(box(2, 1), -1.0, 1.0)),
          std::atan2(-box(2, 0), box(2, 2))};
}

Eigen::Matrix3d rotation_of(const CuboidTurn& turn) {
  return turn_about_z(turn.yaw) * Eigen::AngleAxisd(turn.pitch, Eigen::Vector3d::UnitX()).toRotationMatrix() *
         Eigen::AngleAxisd(turn.roll, Eigen::Vector3d::UnitY()).toRotationMatrix();
}

bool is_pandaset(const fs::path& root) {
  if (is_file(root / "lidar" / "poses.json")) return true;
  return std::any_of(std::begin(kPandasetCameras), std::end(kPandasetCameras),
                     [&](const char* name) { return is_file(root / "camera" / name / "poses.json"); });
}

Scene read_pandaset(const fs::path& root, const ReadOptions& options) { return LogReader(root, options).read(); }

}  // namespace cloam
