// See kitti.h. Frames of axes: imu and velo x forward, y left, z up; cameras x right, y down, z forward; rect is camera
// 0 after rectification, in which the images of all four lie.
#include "models/data/kitti.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <optional>
#include <pugixml.hpp>
#include <set>
#include <sstream>
#include <string_view>
#include <tuple>

#include "models/data/log_builder.h"
#include "models/data/poses.h"
#include "models/io/bytes.h"
#include "models/io/image.h"
#include "models/io/paths.h"
#include "models/io/safetensors_header.h"  // printable
#include "models/io/words.h"
#include "models/scene/pose.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr int kCameras = 4;
constexpr int kMaxDriveSteps = 100000;
constexpr std::size_t kMaxEntries = 10000;  // folders that are looked at in search of drives
constexpr std::uint64_t kMaxCalibrationBytes = std::uint64_t{16} << 20, kMaxXmlBytes = std::uint64_t{32} << 20;
constexpr double kEarthRadius = 6378137;  // metres, at the equator
constexpr double kFrameRate = 10;         // Hz, where time stamps are missing
constexpr double kRadians = std::numbers::pi / 180;

std::string camera_name(int camera) { return text("image_0", camera); }

std::string number_name(int step) { return fmt::format("{:010}", step); }

bool is_folder(const fs::path& path) {
  std::error_code error;
  return fs::is_directory(path, error);
}

bool is_drive(const fs::path& folder) {
  for (int camera = 0; camera < kCameras; ++camera) {
    if (is_folder(folder / camera_name(camera) / "data")) return true;
  }
  return is_folder(folder / "velodyne_points" / "data") && is_folder(folder / "oxts" / "data");
}

std::vector<fs::path> folders_in(const fs::path& folder) {
  std::vector<fs::path> found = entries_of(folder);
  std::erase_if(found, [](const fs::path& entry) { return !is_folder(entry); });
  found.resize(std::min(found.size(), kMaxEntries));
  return found;
}

std::vector<fs::path> drives_in(const fs::path& root) {
  if (is_drive(root)) return {root};
  std::vector<fs::path> drives;
  for (const fs::path& folder : folders_in(root)) {
    const auto likely = is_drive(folder) ? std::vector{folder} : folders_in(folder);
    std::copy_if(likely.begin(), likely.end(), std::back_inserter(drives), is_drive);
  }
  return drives;
}

fs::path one_drive(const fs::path& root) {
  const auto drives = drives_in(root);
  if (drives.size() == 1) return fs::canonical(drives[0]);
  constexpr std::size_t most = 10;
  std::string names;
  for (std::size_t i = 0; i < std::min(most, drives.size()); ++i) names += "\n  " + drives[i].string();
  bad_data(root.string(), ": holds ", drives.size(), " drives, want one; give the folder of one ", "of them:", names,
           drives.size() > most ? "\n  ..." : "");
}

std::string read_text(const fs::path& path) {
  const auto bytes = read_file(path, kMaxCalibrationBytes);
  return {bytes.begin(), bytes.end()};
}

std::vector<std::string> lines_of(const std::string& content) {
  std::vector<std::string> lines;
  std::istringstream rest(content);
  for (std::string line; std::getline(rest, line);) lines.push_back(line);
  return lines;
}

/// A file of lines "name: numbers".
class Calibration {
 public:
  explicit Calibration(const fs::path& path) : path_(path) {
    if (!has_file(path))
      bad_data(path.string(), " is missing: a drive needs its day's calibration in the folder ",
               "above it (the archive ..._calib.zip)");
    for (const std::string& line : lines_of(read_text(path))) {
      const std::size_t colon = line.find(':');
      if (colon != std::string::npos) entries_.emplace(line.substr(0, colon), line.substr(colon + 1));
    }
  }

  bool has(const std::string& name) const { return entries_.contains(name); }
  std::string where(const std::string& name) const { return text(path_.string(), ": ", name); }

  std::vector<double> numbers(const std::string& name, std::size_t count) const {
    if (!has(name)) bad_data(where(name), " is missing");
    return without_quotes(path_, [&] { return first_numbers(entries_.at(name), count, where(name)); });
  }

  Eigen::Matrix3d matrix3(const std::string& name) const {
    return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(numbers(name, 9).data());
  }

  /// Rotation R and translation T.
  Eigen::Matrix4d pose() const {
    const Eigen::Matrix3d rotation = matrix3("R");
    return rigid(pose_from(rotation, Eigen::Vector3d(numbers("T", 3).data())), where("R"));
  }

 private:
  fs::path path_;
  std::map<std::string, std::string> entries_;
};

Eigen::Matrix4d inverse(const Eigen::Matrix4d& pose) { return Eigen::Isometry3d(pose).inverse().matrix(); }

// "2011-09-26 13:04:44.540000000" in seconds since 1970, as if it were UTC; nothing for an empty line.
std::optional<double> time_of(std::string_view line, const std::string& where) {
  while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.remove_suffix(1);
  if (line.empty()) return {};
  const bool shaped = line.size() >= 19 && line[4] == '-' && line[7] == '-' && (line[10] == ' ' || line[10] == 'T') &&
                      line[13] == ':' && line[16] == ':';
  if (!shaped) bad_data(where, ": looked for a time like 2011-09-26 13:04:44.540000000, found '", printable(line), "'");
  const auto whole = [&](std::size_t start, std::size_t size) {
    return number_in<int>(line.substr(start, size)).value_or(-1);  // no part of a time
  };
  const std::chrono::year_month_day day{std::chrono::year(whole(0, 4)), std::chrono::month(unsigned(whole(5, 2))),
                                        std::chrono::day(unsigned(whole(8, 2)))};
  if (!day.ok()) bad_data(where, ": no such date: '", printable(line.substr(0, 10)), "'");
  const double days = double(std::chrono::sys_days(day).time_since_epoch().count());
  return 86400 * days + 3600 * whole(11, 2) + 60 * whole(14, 2) + finite_number(line.substr(17), where);
}

/// The time stamps of one sensor, a line a frame.
class TimeStamps {
 public:
  TimeStamps(const fs::path& drive, const std::string& file) : file_(file), path_(drive / file) {
    if (has_file(path_)) lines_ = lines_of(read_text(path_));
  }

  std::optional<double> at(int step) const {
    if (std::size_t(step) >= lines_.size()) return {};
    const std::size_t line = std::size_t(step);
    return without_quotes(path_, [&] { return time_of(lines_[line], text(file_, ", line ", line + 1)); });
  }

 private:
  std::string file_;
  fs::path path_;
  std::vector<std::string> lines_;
};

// Frame numbers of the files in a folder: 0000000007.png is 7. Other names are no frames.
std::set<int> numbers_in(const fs::path& folder, const char* extension) {
  std::set<int> numbers;
  for (const fs::path& entry : entries_of(folder)) {
    const std::string stem = entry.stem().string();
    const int number = number_in<int>(stem).value_or(-1);
    const bool named = stem.size() == 10 && number >= 0 && number < kMaxDriveSteps;
    if (named && entry.extension() == extension) numbers.insert(number);
  }
  return numbers;
}

Eigen::Matrix4d pose_of(const Eigen::Vector3d& roll_pitch_yaw, const Eigen::Vector3d& position) {
  const Eigen::Quaterniond turn = Eigen::AngleAxisd(roll_pitch_yaw.z(), Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(roll_pitch_yaw.y(), Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(roll_pitch_yaw.x(), Eigen::Vector3d::UnitX());
  return pose_from(turn.toRotationMatrix(), position);
}

/// What GPS and inertial sensors tell: angles in radians, metres above the sea.
struct Oxts {
  double latitude = 0, longitude = 0, altitude = 0;
  Eigen::Vector3d roll_pitch_yaw = Eigen::Vector3d::Zero();  // yaw 0 is east, counter-clockwise
};

Oxts read_oxts(const std::string& content, const std::string& file) {
  const auto values = first_numbers(content, 6, file);
  if (std::abs(values[0]) > 85 || std::abs(values[1]) > 360)
    bad_data(file, ": latitude ", values[0], ", longitude ", values[1], " degrees");
  return {values[0] * kRadians, values[1] * kRadians, values[2], {values[3], values[4], values[5]}};
}

// As the devkit's convertOxtsToPose: Mercator's projection, scaled to metres at the first frame's latitude.
Eigen::Vector3d position(const Oxts& oxts, const Oxts& first) {
  const double scale = kEarthRadius * std::cos(first.latitude);
  const double north = std::log(std::tan(std::numbers::pi / 4 + oxts.latitude / 2));
  return {scale * oxts.longitude, scale * north, oxts.altitude};
}

class DriveReader {
 public:
  DriveReader(const fs::path& drive, const ReadOptions& options)
      : drive_(drive),
        log_(drive, "KITTI", options),
        cameras_(calibration("calib_cam_to_cam.txt")),
        oxts_times_(drive, "oxts/timestamps.txt"),
        sweep_times_(drive, "velodyne_points/timestamps.txt") {
    const Eigen::Matrix4d velo_from_imu = calibration("calib_imu_to_velo.txt").pose(),
                          cam0_from_velo = calibration("calib_velo_to_cam.txt").pose();
    const Eigen::Matrix4d rect_from_cam0 = pose_from(cameras_.matrix3("R_rect_00"), Eigen::Vector3d::Zero());
    imu_from_velo_ = inverse(velo_from_imu);
    imu_from_rect_ =
        imu_from_velo_ * inverse(cam0_from_velo) * inverse(rigid(rect_from_cam0, cameras_.where("R_rect_00")));
  }

  Scene read() {
    if (drive_.filename().string().ends_with("_extract"))
      bad_data(drive_.string(), ": is an unsynchronised drive, whose images are not rectified; ",
               "download the drive named ..._sync");
    read_poses();
    for (int camera = 0; camera < kCameras; ++camera) {
      if (is_folder(drive_ / camera_name(camera) / "data")) read_camera(camera);
    }
    if (is_folder(drive_ / "velodyne_points/data")) read_sweeps();
    if (has_file(drive_ / "tracklet_labels.xml")) log_.guarded("tracklets", [&] { read_tracklets(); });
    return log_.finish({"image_0*/data", "velodyne_points/data/*.bin", "tracklet_labels.xml"});
  }

 private:
  Calibration calibration(const char* name) const { return Calibration(drive_.parent_path() / name); }

  std::set<int> numbers(const std::string& folder, const char* extension) const {
    return numbers_in(drive_ / folder, extension);
  }

  void read_poses() {
    std::optional<Oxts> first;
    for (const int step : numbers("oxts/data", ".txt")) {
      const std::string file = "oxts/data/" + number_name(step) + ".txt";
      log_.guarded("pose", [&] {
        const std::string content = read_text(drive_ / file);
        const Oxts oxts = without_quotes(drive_ / file, [&] { return read_oxts(content, file); });
        if (!first) first = oxts;
        const Eigen::Vector3d place = position(oxts, *first) - position(*first, *first);
        if (place.norm() > kFarthestOfLog)
          bad_data(file, ": the car is ", place.norm(), " m away from its first position");
        world_from_imu_.emplace(step, rigid(pose_of(oxts.roll_pitch_yaw, place), file));
      });
    }
    if (!world_from_imu_.empty()) return;
    bad_data(drive_.string(), ": no pose: looked for oxts/data/0000000000.txt and so on, which ",
             "the archives ..._sync.zip hold");
  }

  // Files of one sensor by step: those that are there, and those that the poses lead one to expect.
  template <class Add>
  void for_each_step(const std::string& folder, const char* extension, Add add) {
    const std::set<int> found = numbers(folder, extension);
    std::set<int> steps = found;
    for (const auto& [step, pose] : world_from_imu_) steps.insert(step);
    for (const int step : steps) {
      const std::string file = folder + "/" + number_name(step) + extension;
      const auto pose = world_from_imu_.find(step);
      if (!found.contains(step)) {
        log_.missing(file);
      } else if (pose == world_from_imu_.end()) {
        log_.missing("oxts/data/" + number_name(step) + ".txt");
      } else {
        add(step, file, pose->second);
      }
    }
  }

  void read_camera(int number) {
    const std::string name = camera_name(number), folder = name + "/data";
    const TimeStamps times(drive_, name + "/timestamps.txt");
    const char* extension = numbers(folder, ".png").empty() && !numbers(folder, ".jpg").empty() ? ".jpg" : ".png";
    std::optional<RectifiedCamera> camera;
    for_each_step(folder, extension, [&](int step, const std::string& file, const Eigen::Matrix4d& world_from_imu) {
      ++scene_.frames_listed;
      log_.guarded("frame", [&] {
        if (!camera) camera = read_intrinsics(number, file);
        Frame frame;
        frame.name = frame.image = file;
        frame.sensor = name;
        frame.step = step;
        frame.timestamp = time_at(times, step);
        frame.world_from_camera = world_from_imu * imu_from_rect_ * camera->rect_from_camera;
        frame.camera = find_or_add(scene_.cameras, camera->intrinsics);
        scene_.frames.push_back(std::move(frame));
      });
    });
  }

  struct RectifiedCamera {
    Camera intrinsics;
    Eigen::Matrix4d rect_from_camera;
  };

  // P_rect = K [I | t]: pixels from points in rect, with the camera at -t. No half pixel is added to the centre: LiDAR
  // fits the images better without.
  RectifiedCamera read_intrinsics(int number, const std::string& image) const {
    const std::string key = text("P_rect_0", number), size_key = text("S_rect_0", number);
    const auto values = cameras_.numbers(key, 12);
    const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> projection(values.data());
    const Eigen::Matrix3d intrinsics = projection.leftCols<3>();
    const Eigen::Vector3d others(intrinsics(0, 1), intrinsics(1, 0), intrinsics(2, 0));
    if (others.norm() > 1e-6 || std::abs(intrinsics(2, 1)) > 1e-9 || std::abs(intrinsics(2, 2) - 1) > 1e-9)
      bad_data(cameras_.where(key), " is not the projection of a rectified image: looked for ",
               "fx 0 cx ., 0 fy cy ., 0 0 1 .");
    Camera camera{0, 0, intrinsics(0, 0), intrinsics(1, 1), intrinsics(0, 2), intrinsics(1, 2)};
    require_sound(camera, cameras_.where(key));
    const Eigen::Matrix4d shift = pose_from(Eigen::Matrix3d::Identity(), -(intrinsics.inverse() * projection.col(3)));
    const Eigen::Matrix4d rect_from_camera = rigid(shift, cameras_.where(key));
    std::tie(camera.width, camera.height) = read_size(size_key, image);
    return {camera, rect_from_camera};
  }

  std::pair<int, int> read_size(const std::string& key, const std::string& image) const {
    if (!cameras_.has(key)) {
      const ImageSize size = read_image_size(drive_ / image);
      return {size.width, size.height};
    }
    constexpr double longest = 1 << 17;
    const auto size = cameras_.numbers(key, 2);
    const bool sound = std::all_of(size.begin(), size.end(), [](double side) { return side >= 1 && side <= longest; });
    if (!sound) bad_data(cameras_.where(key), " is ", size[0], " by ", size[1], " pixels");
    return {int(size[0]), int(size[1])};
  }

  double time_at(const TimeStamps& times, int step) const {
    if (const auto own = times.at(step)) return *own;
    return oxts_times_.at(step).value_or(step / kFrameRate);
  }

  void read_sweeps() {
    for_each_step(
        "velodyne_points/data", ".bin", [&](int step, const std::string& file, const Eigen::Matrix4d& world_from_imu) {
          log_.guarded("sweep", [&] {
            scene_.sweeps.push_back(
                {file, time_at(sweep_times_, step), world_from_imu * imu_from_velo_, step, Split::train, false});
          });
        });
  }

  // The XML of a Boost archive: <tracklets> with an <item> each, whose <poses> have an <item> a frame.
  void read_tracklets() {
    const std::string file = "tracklet_labels.xml";
    auto bytes = read_file(drive_ / file, kMaxXmlBytes);
    pugi::xml_document document;  // expands no entity that a file defines
    const auto parsed = document.load_buffer_inplace(bytes.data(), bytes.size());
    if (!parsed) bad_data(file, ": byte ", parsed.offset, ": ", parsed.description());
    const pugi::xml_node tracklets = document.child("boost_serialization").child("tracklets");
    if (!tracklets) bad_data(file, ": has no <tracklets> in <boost_serialization>");
    int index = 0;
    for (const pugi::xml_node tracklet : tracklets.children("item")) {
      const std::string id = fmt::format("{:03}", index++);
      log_.guarded("tracklet", [&] { read_tracklet(tracklet, id, text(file, ", tracklet ", id)); });
    }
    if (boxes_without_pose_ > 0)
      scene_.warnings.push_back(text(boxes_without_pose_, " boxes dropped: their frames have no pose in oxts/data"));
  }

  static double value_of(const pugi::xml_node& node, const char* key, const std::string& where) {
    const pugi::xml_node child = node.child(key);
    if (!child) bad_data(where, ": <", key, "> is missing");
    return finite_number(child.text().get(), text(where, ": <", key, ">"));
  }

  void read_tracklet(const pugi::xml_node& tracklet, const std::string& id, const std::string& where) {
    const double height = value_of(tracklet, "h", where), first = value_of(tracklet, "first_frame", where);
    const Eigen::Vector3d size(value_of(tracklet, "w", where), value_of(tracklet, "l", where), height);
    if (!(first >= 0 && first < kMaxDriveSteps)) bad_data(where, ": <first_frame> is ", first);
    const std::string label = printable(tracklet.child("objectType").text().get());
    int step = int(first);
    for (const pugi::xml_node pose : tracklet.child("poses").children("item")) {
      const std::string place = text(where, ", frame ", step);
      const Eigen::Matrix4d velo_from_box = read_box(pose, height, place);
      const auto car = world_from_imu_.find(step);
      if (car == world_from_imu_.end())
        ++boxes_without_pose_;
      else
        log_.add(
            {id, label, size, false, {step, time_at(sweep_times_, step), car->second * imu_from_velo_ * velo_from_box}},
            place);
      ++step;
    }
  }

  // A tracklet's x points forward and its origin is the middle of the underside; here y does, and it is the centre.
  static Eigen::Matrix4d read_box(const pugi::xml_node& pose, double height, const std::string& where) {
    const auto value = [&](const char* key) { return value_of(pose, key, where); };
    const Eigen::Vector3d angles(value("rx"), value("ry"), value("rz")), place(value("tx"), value("ty"), value("tz"));
    const Eigen::Matrix3d turn{{0, 1, 0}, {-1, 0, 0}, {0, 0, 1}};
    return pose_of(angles, place) * pose_from(turn, {0, 0, height / 2});
  }

  fs::path drive_;
  LogBuilder log_;
  Scene& scene_ = log_.scene;
  Calibration cameras_;
  TimeStamps oxts_times_, sweep_times_;
  Eigen::Matrix4d imu_from_velo_ = Eigen::Matrix4d::Identity(), imu_from_rect_ = Eigen::Matrix4d::Identity();
  std::map<int, Eigen::Matrix4d> world_from_imu_;
  int boxes_without_pose_ = 0;
};

}  // namespace

bool is_kitti(const fs::path& root) { return !drives_in(root).empty(); }

Scene read_kitti(const fs::path& root, const ReadOptions& options) {
  return DriveReader(one_drive(root), options).read();
}

}  // namespace cloam
