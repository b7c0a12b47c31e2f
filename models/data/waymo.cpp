// See waymo.h. Axes: car and boxes x forward, y left, z up; so are those of cameras in Waymo's own calibration.
#include "models/data/waymo.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "models/data/log_builder.h"
#include "models/data/poses.h"
#include "models/io/bytes.h"
#include "models/io/image.h"
#include "models/io/json.h"
#include "models/io/paths.h"
#include "models/io/safetensors_header.h"  // printable
#include "models/io/words.h"
#include "models/scene/pose.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr double kFramesASecond = 10;
constexpr std::uint64_t kMostText = std::uint64_t{1} << 20;
constexpr const char* kCameras[] = {"front_camera", "front_left_camera", "front_right_camera", "left_camera",
                                    "right_camera"};

std::string frame_name(int step) { return fmt::format("{:03}", step); }

/// The numbers of a file that NumPy's savetxt wrote. Fault::data for fewer than `count` and for what is no number.
std::vector<double> numbers_in(const fs::path& root, const std::string& file, std::size_t count) {
  const auto bytes = read_file(root / file, kMostText);
  return first_numbers(std::string(bytes.begin(), bytes.end()), count, file);
}

Eigen::Matrix4d matrix_of(const std::vector<double>& by_rows) {
  return Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(by_rows.data());
}

/// Where the LiDAR on the roof is in the car's axes: the first return says it. All returns of a sweep are from about
/// there (the car moves on by a metre while the LiDAR turns once).
Eigen::Vector3d lidar_place(const fs::path& path, const std::string& file) {
  std::ifstream in(path, std::ios::binary);
  float row[kWaymoPointNumbers];
  while (in.read(reinterpret_cast<char*>(row), sizeof row))
    if (row[kWaymoPointNumbers - 1] == 0) return Eigen::Map<const Eigen::Vector3f>(row).cast<double>();
  bad_data(file, ": looked for a return of LiDAR 0, on the roof, in rows of ", kWaymoPointNumbers,
           " float32, found none\n  fix: unpack the drive again, with Waymo's LiDAR");
}

class WaymoReader {
 public:
  WaymoReader(const fs::path& root, const ReadOptions& options) : log_(root, "Waymo", options) {}

  Scene read() {
    read_car();
    find_gaps();
    for (int camera = 0; camera < static_cast<int>(std::size(kCameras)); ++camera) read_camera(camera);
    for (const auto& [step, pose] : world_from_car_) read_sweep(step, pose);
    if (has_file(scene_.root / kBoxes)) read_boxes();
    if (has_file(scene_.root / kInfo)) {
      const Json info = parse_json_file(scene_.root / kInfo);
      scene_.night = optional_string(info, "time_of_day", kInfo).value_or("") == "Night";
    }
    return log_.finish({"images/*_*.jpg", "lidar/*.bin", kBoxes});
  }

 private:
  static constexpr const char* kBoxes = "instances/instances_info.json";
  static constexpr const char* kInfo = "frame_info.json";

  /// Positions count from a corner of a town: float32 would blur that far away.
  void read_car() {
    for (const fs::path& entry : entries_of(scene_.root / "ego_pose")) {
      const auto step = number_in<int>(entry.stem().string());
      if (!step || *step < 0 || entry.extension() != ".txt") continue;
      const std::string file = "ego_pose/" + entry.filename().string();
      log_.guarded("pose of the car", [&] {
        Eigen::Matrix4d pose = rigid(matrix_of(numbers_in(scene_.root, file, 16)), file);
        if (world_from_car_.empty()) origin_ = pose.topRightCorner<3, 1>();
        pose.topRightCorner<3, 1>() -= origin_;
        if (pose.topRightCorner<3, 1>().norm() > kFarthestOfLog)
          bad_data(file, ": is more than ", kFarthestOfLog, " m away from the first pose");
        world_from_car_[*step] = pose;
      });
    }
  }

  /// Images without a pose of the car, and cameras without extrinsics.
  void find_gaps() {
    std::set<std::string> wanted;
    for (const fs::path& entry : entries_of(scene_.root / "images")) {
      const std::string name = entry.stem().string();
      const auto step = number_in<int>(name.substr(0, name.find('_')));
      const auto camera = number_in<int>(name.substr(std::min(name.find('_'), name.size() - 1) + 1));
      if (!step || !camera || *camera >= static_cast<int>(std::size(kCameras))) continue;
      wanted.insert(text("ego_pose/", frame_name(*step), ".txt"));
      wanted.insert(text("extrinsics/", *camera, ".txt"));
    }
    for (const std::string& file : wanted)
      if (!has_file(scene_.root / file)) log_.missing(file);
  }

  /// Waymo's camera axes have z up; OpenCV's, with z forward, are read, too.
  Eigen::Matrix4d car_from_camera(int camera) const {
    const std::string file = text("extrinsics/", camera, ".txt");
    const Eigen::Matrix4d given = rigid(matrix_of(numbers_in(scene_.root, file, 16)), file);
    const Eigen::Matrix3d from_opencv{{0, 0, 1}, {-1, 0, 0}, {0, -1, 0}};
    const bool z_is_up = given(2, 2) > 0.5;
    return z_is_up ? given * pose_from(from_opencv, {0, 0, 0}) : given;
  }

  Camera intrinsics_of(int camera, const std::string& image) const {
    const std::string file = text("intrinsics/", camera, ".txt");
    const std::vector<double> n = numbers_in(scene_.root, file, 9);  // fx fy cx cy k1 k2 p1 p2 k3
    const ImageSize size = read_image_size(scene_.root / image);
    Camera out{size.width, size.height, n[0], n[1], n[2], n[3]};
    out.k = {n[4], n[5], n[8], 0};
    out.p1 = n[6], out.p2 = n[7];
    if (std::any_of(n.begin() + 4, n.end(), [](double term) { return term != 0; })) out.model = CameraModel::opencv;
    require_sound(out, file);
    return out;
  }

  void read_camera(int camera) {
    if (!has_file(scene_.root / text("extrinsics/", camera, ".txt"))) return;
    const Eigen::Matrix4d car_from = car_from_camera(camera);
    int listed = -1;
    for (const auto& [key, pose] : world_from_car_) {
      const int step = key;  // a lambda of Clang before 16 takes no structured binding
      const Eigen::Matrix4d& world_from_car = pose;
      ++scene_.frames_listed;
      std::string image = text("images/", frame_name(step), "_", camera, ".jpg");
      if (!has_file(scene_.root / image)) image.replace(image.size() - 3, 3, "png");
      if (!has_file(scene_.root / image)) {
        log_.missing(text("images/", frame_name(step), "_", camera, ".jpg"));
        continue;
      }
      log_.guarded("frame", [&] {
        if (listed < 0) listed = find_or_add(scene_.cameras, intrinsics_of(camera, image));
        Frame frame;
        frame.name = frame.image = image;
        frame.sensor = kCameras[camera];
        frame.step = step;
        frame.timestamp = step / kFramesASecond;
        frame.world_from_camera = world_from_car * car_from;
        frame.camera = listed;
        scene_.frames.push_back(std::move(frame));
      });
    }
  }

  void read_sweep(int step, const Eigen::Matrix4d& world_from_car) {
    const std::string file = text("lidar/", frame_name(step), ".bin");
    if (!has_file(scene_.root / file)) return log_.missing(file);
    log_.guarded("sweep", [&] {
      const Eigen::Vector3d place = lidar_place(scene_.root / file, file);
      scene_.sweeps.push_back({file, step / kFramesASecond,
                               world_from_car * pose_from(Eigen::Matrix3d::Identity(), place), step, Split::train,
                               false});
    });
  }

  void read_boxes() {
    const Json all = parse_json_file(scene_.root / kBoxes);
    for (const auto& entry : all.items()) {
      const std::string where = text(kBoxes, ", instance ", printable(entry.key()));
      log_.guarded("actor", [&] { read_actor(entry.value(), where); });
    }
    if (boxes_after_end_ > 0)
      scene_.warnings.push_back(text(boxes_after_end_, " boxes are left out: they are after the last pose of the car"));
  }

  /// An instance's x points forward; here y does.
  void read_actor(const Json& actor, const std::string& where) {
    const Json& boxes = member(actor, "frame_annotations", where);
    const Json &steps = array(boxes, "frame_idx", where), &poses = array(boxes, "obj_to_world", where),
               &sizes = array(boxes, "box_size", where);
    if (steps.size() != poses.size() || steps.size() != sizes.size())
      bad_data(where, ": has ", steps.size(), " entries of frame_idx, ", poses.size(), " of obj_to_world and ",
               sizes.size(), " of box_size, want as many");
    const std::string id = string(actor, "id", where), label = printable(string(actor, "class_name", where));
    const Eigen::Matrix3d turn{{0, 1, 0}, {-1, 0, 0}, {0, 0, 1}};
    const int last = world_from_car_.empty() ? -1 : world_from_car_.rbegin()->first;
    for (std::size_t i = 0; i < steps.size(); ++i) {
      const std::string place = text(where, ", box ", i);
      log_.guarded("box", [&] {
        const std::vector<double> pose = flat(poses[i], 16, place), size = flat(sizes[i], 3, place);  // length first
        const double frame = flat(Json::array({steps[i]}), 1, place)[0];
        if (frame < 0) bad_data(place, ": frame_idx is ", frame, ", want 0 or more");
        if (frame > last) {
          ++boxes_after_end_;
          return;
        }
        const int step = static_cast<int>(frame);
        Eigen::Matrix4d world_from_box = matrix_of(pose) * pose_from(turn, {0, 0, 0});
        world_from_box.topRightCorner<3, 1>() -= origin_;
        log_.add({id, label, {size[1], size[0], size[2]}, false, {step, step / kFramesASecond, world_from_box}}, place);
      });
    }
  }

  /// The numbers of a list of numbers or of lists of them.
  static std::vector<double> flat(const Json& list, std::size_t count, const std::string& where) {
    std::vector<double> out;
    const auto take = [&](const Json& value) { out.push_back(value.is_number() ? value.get<double>() : NAN); };
    for (const Json& value : list) {
      if (!value.is_array()) take(value);
      if (value.is_array()) std::for_each(value.begin(), value.end(), take);
    }
    const bool finite = std::all_of(out.begin(), out.end(), [](double value) { return std::isfinite(value); });
    if (out.size() != count || !finite) bad_data(where, ": looked for ", count, " finite numbers, found ", out.size());
    return out;
  }

  LogBuilder log_;
  Scene& scene_ = log_.scene;
  std::map<int, Eigen::Matrix4d> world_from_car_;  // by step
  int boxes_after_end_ = 0;
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
};

}  // namespace

bool is_waymo(const fs::path& root) {
  return is_file(root / "ego_pose" / "000.txt") && is_file(root / "extrinsics" / "0.txt") &&
         is_file(root / "intrinsics" / "0.txt");
}

Scene read_waymo(const fs::path& root, const ReadOptions& options) { return WaymoReader(root, options).read(); }

}  // namespace cloam
