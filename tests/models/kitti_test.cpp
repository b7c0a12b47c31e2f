// KITTI's raw layout: a small drive against KITTI's own formulas, the real one, and what may be broken in a drive.
#include "models/data/kitti.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "models/data/check_log.h"
#include "models/data/load_images.h"
#include "models/data/load_sweep.h"
#include "models/data/read_scene.h"
#include "models/io/image.h"
#include "models/runs/recorded_log.h"
#include "models/scene/split.h"
#include "runtime/error.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"
#include "tests/models/told.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

constexpr int kSteps = 3;

std::string numbers(const Eigen::MatrixXd& matrix) {
  std::ostringstream out;
  out.precision(17);
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) out << ' ' << matrix(r, c);
  }
  return out.str();
}

Eigen::Matrix3d turn(double angle, const Eigen::Vector3d& axis) {
  return Eigen::AngleAxisd(angle, axis.normalized()).toRotationMatrix();
}

Eigen::Matrix4d pose(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& position) {
  Eigen::Matrix4d result = Eigen::Matrix4d::Identity();
  result.topLeftCorner<3, 3>() = rotation;
  result.topRightCorner<3, 1>() = position;
  return result;
}

// What the files of the small drive say.
struct Truth {
  Eigen::Matrix3d rectify = turn(0.02, {1, 2, 3});
  Eigen::Matrix4d cam0_from_velo, velo_from_imu = pose(turn(0.01, {3, 1, 2}), {-0.8, 0.3, -0.7});
  Eigen::Matrix<double, 3, 4> projection;  // of camera 2
  double yaw = 0.3;                        // from east, counter-clockwise
  // Metres that the car drives east and north in a step.
  Eigen::Vector3d stride = {3, 2, 0.25};

  Truth() {
    Eigen::Matrix3d axes;  // camera x right, y down, z forward; velodyne x forward, y left, z up
    axes << 0, -1, 0, 0, 0, -1, 1, 0, 0;
    cam0_from_velo = pose(turn(0.015, {1, -1, 1}) * axes, {0.01, -0.07, -0.27});
    projection << 20, 0, 16.5, 1.25, 0, 21, 5.5, 0.04, 0, 0, 1, 0.003;
  }
  Eigen::Matrix4d world_from_imu(int step) const { return pose(turn(yaw, {0, 0, 1}), step * stride); }

  // As the devkit writes it: x = P_rect R_rect Tr_velo_to_cam Tr_imu_to_velo X.
  Eigen::Vector2d pixel(const Eigen::Vector3d& world, int step) const {
    const Eigen::Vector4d imu = world_from_imu(step).inverse() * world.homogeneous();
    const Eigen::Vector3d place = projection * (pose(rectify, {0, 0, 0}) * cam0_from_velo * velo_from_imu * imu);
    return place.hnormalized();
  }
};

std::string tracklets(const std::string& height = "1.5") {
  return R"(<?xml version="1.0"?><boost_serialization><tracklets><count>1</count><item_version>1</item_version>
<item><objectType>Car</objectType><h>)" +
         height + R"(</h><w>1.8</w><l>4.2</l><first_frame>1</first_frame>
<poses><count>2</count><item_version>2</item_version>
<item><tx>10</tx><ty>2</ty><tz>-1.7</tz><rx>0</rx><ry>0</ry><rz>0.5</rz><state>2</state></item>
<item><tx>11</tx><ty>2</ty><tz>-1.7</tz><rx>0</rx><ry>0</ry><rz>0.5</rz><state>2</state></item>
</poses><finished>1</finished></item></tracklets></boost_serialization>)";
}

std::string oxts_of(const Truth& truth, int step) {
  constexpr double radius = 6378137, degrees = 180 / std::numbers::pi, latitude = 49, longitude = 8.4;
  const Eigen::Vector3d place = step * truth.stride;
  std::ostringstream out;
  out.precision(17);
  out << latitude + place.y() / radius * degrees << ' '
      << longitude + place.x() / (radius * std::cos(latitude / degrees)) * degrees << ' ' << 110 + place.z() << " 0 0 "
      << truth.yaw << " 0 0 0\n";
  return out.str();
}

void write_points(const fs::path& path, const std::vector<float>& values) {
  fs::create_directories(path.parent_path());
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(values.data()), std::streamsize(values.size() * sizeof(float)));
}

std::string number_of(int step) { return "000000000" + std::to_string(step); }

std::string stamps(int hundredths) {
  std::string lines;
  for (int step = 0; step < kSteps; ++step) {
    lines += "2011-09-26 13:04:44." + std::to_string(step) + std::to_string(hundredths) + "0000000\n";
  }
  return lines;
}

// One camera, three frames, a car from the second on.
fs::path write_drive(const fs::path& root, const Truth& truth = {}) {
  const fs::path day = root / "2011_09_26", drive = day / "2011_09_26_drive_0007_sync";
  write_text(day / "calib_cam_to_cam.txt", "calib_time: 09-Jan-2012 13:57:47\nR_rect_00:" + numbers(truth.rectify) +
                                               "\nS_rect_02: 3.2e+01 1.2e+01\nP_rect_02:" + numbers(truth.projection) +
                                               "\n");
  const auto rigid_text = [](const Eigen::Matrix4d& given) {
    return "R:" + numbers(given.topLeftCorner<3, 3>()) + "\nT:" + numbers(given.topRightCorner<3, 1>()) + "\n";
  };
  write_text(day / "calib_velo_to_cam.txt", rigid_text(truth.cam0_from_velo));
  write_text(day / "calib_imu_to_velo.txt", rigid_text(truth.velo_from_imu));
  for (int step = 0; step < kSteps; ++step) {
    write_text(drive / "oxts/data" / (number_of(step) + ".txt"), oxts_of(truth, step));
    fs::create_directories(drive / "image_02/data");
    write_png(drive / "image_02/data" / (number_of(step) + ".png"),
              {32, 12, 3, std::vector<std::uint8_t>(3 * 32 * 12, 100)});
    write_points(drive / "velodyne_points/data" / (number_of(step) + ".bin"),
                 {10, 2, -1, 0.5, float(step), -3, 1, 2, NAN, 0, 0, 0});
  }
  write_text(drive / "image_02/timestamps.txt", stamps(4));
  write_text(drive / "velodyne_points/timestamps.txt", stamps(5));
  write_text(drive / "oxts/timestamps.txt", stamps(6));
  write_text(drive / "tracklet_labels.xml", tracklets());
  return drive;
}

fs::path data_folder() { return test_data("kitti"); }

}  // namespace

TEST_CASE("KITTI: images, scans and boxes lie where KITTI's formulas put them") {
  const Folder folder;
  const Truth truth;
  const fs::path drive = write_drive(folder.path, truth);
  const Scene scene = read_scene(folder.path);  // the root of one drive
  CHECK(scene.format == "KITTI");
  CHECK(scene.root == fs::canonical(drive));
  CHECK(scene.is_log);
  CHECK(scene.metric);
  CHECK(scene.warnings.empty());
  REQUIRE(scene.frames.size() == kSteps);
  REQUIRE(scene.cameras.size() == 1);
  CHECK(scene.cameras[0].width == 32);
  CHECK(scene.cameras[0].height == 12);
  const Eigen::Matrix4d imu_from_velo = truth.velo_from_imu.inverse();
  for (int step = 0; step < kSteps; ++step) {
    const Frame& frame = scene.frames[std::size_t(step)];
    CAPTURE(step);
    CHECK(frame.step == step);
    CHECK(frame.sensor == "image_02");
    CHECK(*frame.timestamp == doctest::Approx(1317042284.04 + 0.1 * step).epsilon(1e-15));
    for (const Eigen::Vector3d& ahead : {Eigen::Vector3d(12, 1, 0), Eigen::Vector3d(30, -4, 2)}) {
      const Eigen::Vector3d world = (truth.world_from_imu(step) * ahead.homogeneous()).head<3>();
      const Eigen::Vector3d seen = (frame.world_from_camera.inverse() * world.homogeneous()).head<3>();
      CHECK((project(scene.cameras[0], seen) - truth.pixel(world, step)).norm() < 1e-3);
    }
    const Sweep& sweep = scene.sweeps[std::size_t(step)];
    CHECK(sweep.timestamp == doctest::Approx(1317042284.05 + 0.1 * step).epsilon(1e-15));
    const LidarPoints points = load_sweep(scene, sweep);
    REQUIRE(points.size() == 2);
    CHECK(points.dropped == 1);
    CHECK(points.intensities == std::vector<float>{0.5, 1});
    const Eigen::Vector4d wanted = truth.world_from_imu(step) * imu_from_velo * Eigen::Vector4d(10, 2, -1, 1);
    CHECK((Eigen::Vector3f(points.positions.data()).cast<double>() - wanted.head<3>()).norm() < 1e-4);
  }
  REQUIRE(scene.actors.size() == 1);
  const Actor& car = scene.actors[0];
  CHECK(car.label == "Car");
  CHECK(car.size == Eigen::Vector3d(1.8, 4.2, 1.5));
  REQUIRE(car.boxes.size() == 2);
  CHECK(car.boxes[0].step == 1);
  CHECK(car.boxes[0].timestamp == scene.sweeps[1].timestamp);
  const Eigen::Matrix4d velo_from_box =
      truth.velo_from_imu * truth.world_from_imu(1).inverse() * car.boxes[0].world_from_box;
  const double c = std::cos(0.5), s = std::sin(0.5);
  Eigen::Matrix4d wanted;
  wanted << s, c, 0, 10, -c, s, 0, 2, 0, 0, 1, -1.7 + 0.75, 0, 0, 0, 1;
  CHECK((velo_from_box - wanted).cwiseAbs().maxCoeff() < 1e-4);
  CHECK(read_scene(drive).frames.size() == kSteps);  // the drive itself
  CHECK(load_images(scene, Split::train).frames.size() == kSteps);
}

TEST_CASE("KITTI: a drive is written in PandaSet's layout, under its cameras' names") {
  const Folder folder;
  write_drive(folder.path / "day");
  const Scene drive = read_scene(folder.path / "day");
  Told told;
  write_recorded_log(folder.path / "log", drive, false, told.listener());
  CHECK(holds(told.said, "the camera image_02 is written as front_camera"));
  const Scene log = read_scene(folder.path / "log");
  REQUIRE(log.frames.size() == kSteps);
  for (std::size_t i = 0; i < kSteps; ++i) {
    CHECK(log.frames[i].sensor == "front_camera");
    CHECK((log.frames[i].world_from_camera - drive.frames[i].world_from_camera).norm() < 1e-9);
    CHECK(*log.frames[i].timestamp == doctest::Approx(*drive.frames[i].timestamp).epsilon(1e-15));
    const Image photo = photo_of(log, log.frames[i]);
    CHECK((photo.width == 32 && photo.height == 12));
    CHECK(content_of(log.root / log.frames[i].image) == content_of(drive.root / drive.frames[i].image));
    CHECK(load_sweep(log, log.sweeps[i]).intensities == std::vector<float>{128.f / 255, 1});
  }
  REQUIRE(log.actors.size() == 1);
  REQUIRE(log.actors[0].boxes.size() == 2);
  CHECK(log.actors[0].size == drive.actors[0].size);
  for (std::size_t b = 0; b < 2; ++b) {
    const Eigen::Matrix4d &is = log.actors[0].boxes[b].world_from_box, &was = drive.actors[0].boxes[b].world_from_box;
    CHECK(std::abs(was(2, 0)) + std::abs(was(2, 1)) > 1e-3);  // tilted, as the scanner is
    CHECK((is - was).norm() < 1e-9);
  }
}

TEST_CASE("KITTI: --holdout takes whole steps; check_log finds boxes and times in order") {
  const Folder folder;
  write_drive(folder.path);
  Scene scene = read_scene(folder.path);
  apply_holdout(scene, 2);
  for (const Frame& frame : scene.frames) CHECK((frame.split == Split::test) == (frame.step != 1));
  for (const Sweep& sweep : scene.sweeps) CHECK((sweep.split == Split::test) == (sweep.step != 1));
  const LogReport report = check_log(scene);
  CHECK(report.rate == doctest::Approx(10).epsilon(1e-3));
  CHECK(report.boxes == 2);
  CHECK(report.boxes_without_points == 0);
  CHECK(report.points_dropped == kSteps);
  CHECK(report.fits.size() == 1);
}

TEST_CASE("KITTI: what is missing is warned of, and time stamps are found elsewhere") {
  const Folder folder;
  const fs::path drive = write_drive(folder.path);
  fs::remove(drive / "image_02/data/0000000001.png");
  fs::remove(drive / "velodyne_points/data/0000000002.bin");
  fs::remove(drive / "velodyne_points/timestamps.txt");
  Scene scene = read_scene(drive);
  CHECK(scene.frames.size() == kSteps - 1);
  CHECK(scene.sweeps.size() == kSteps - 1);
  CHECK(scene.sweeps[0].timestamp == doctest::Approx(1317042284.06).epsilon(1e-15));
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "2 listed files are missing and skipped: image_02/data/0000000001.png"));
  fs::remove(drive / "oxts/timestamps.txt");
  CHECK(read_scene(drive).sweeps[1].timestamp == doctest::Approx(0.1));
  fs::remove(drive / "oxts/data/0000000002.txt");  // the pose that an image and a box need
  scene = read_scene(drive);
  CHECK(scene.frames.size() == 1);
  REQUIRE(scene.actors.size() == 1);
  CHECK(scene.actors[0].boxes.size() == 1);
  CHECK(scene.warnings.size() == 2);
  fs::remove_all(drive / "velodyne_points");
  fs::remove(drive / "tracklet_labels.xml");
  CHECK(read_scene(drive).sweeps.empty());
  fs::remove_all(drive / "oxts");
  CHECK(holds(error_of([&] { read_scene(drive); }), "no pose: looked for oxts/data/0000000000.txt"));
}

TEST_CASE("KITTI: a root of several drives lists them") {
  const Folder folder;
  const fs::path drive = write_drive(folder.path);
  fs::copy(drive, drive.parent_path() / "2011_09_26_drive_0009_sync", fs::copy_options::recursive);
  const std::string error = error_of([&] { read_scene(folder.path); });
  CHECK(holds(error, "holds 2 drives, want one"));
  CHECK(holds(error, "2011_09_26_drive_0007_sync\n"));
  CHECK(holds(error, "2011_09_26_drive_0009_sync"));
}

TEST_CASE("KITTI: broken files are named") {
  const Folder folder;
  const fs::path drive = write_drive(folder.path), day = drive.parent_path();
  const auto broken = [&](const fs::path& file, const std::string& content, const std::string& wanted) {
    std::ifstream stream(file, std::ios::binary);
    const std::string sound{std::istreambuf_iterator<char>(stream), {}};
    write_text(file, content);
    CHECK(holds(error_of([&] { read_scene(drive); }), wanted));
    write_text(file, sound);
  };
  const fs::path oxts = drive / "oxts/data/0000000001.txt", cameras = day / "calib_cam_to_cam.txt";
  broken(oxts, "49 8.4 110 0 nan 0.3", "oxts/data/0000000001.txt: looked for a finite number, found 'nan'");
  broken(oxts, "49 8.4 110", "looked for 6 numbers, found 3");
  broken(oxts, "90 8.4 110 0 0 0", "latitude 90");
  broken(oxts, "49 12 110 0 0 0", "m away from its first position");
  broken(cameras, "R_rect_00: 1 0 0 0 1 0 0 0 1\n", "P_rect_02 is missing");
  broken(cameras, "P_rect_02: 1\n", "R_rect_00 is missing");
  const std::string rotation = "R_rect_00: 1 0 0 0 1 0 0 0 1\n";
  broken(cameras, rotation + "P_rect_02: 1 1 1 1 1 1 1 1 1 1 1 1\n", "not the projection of a rectified image");
  broken(cameras, rotation + "P_rect_02: 0 0 9 0 0 9 9 0 0 0 1 0\n", "implausible intrinsics");
  broken(cameras, rotation + "S_rect_02: 1e9 5\nP_rect_02: 9 0 9 0 0 9 9 0 0 0 1 0\n", "S_rect_02 is 1e+09 by 5");
  broken(day / "calib_velo_to_cam.txt", "R: 1 0 0 0 1 0 0 0 -1\nT: 0 0 0\n", "mirrored");
  broken(drive / "image_02/timestamps.txt", "yesterday\n", "image_02/timestamps.txt, line 1");
  broken(drive / "image_02/timestamps.txt", "2011-13-26 13:04:44.5\n", "no such date: '2011-13-26'");
  fs::rename(day / "calib_imu_to_velo.txt", day / "away");
  CHECK(holds(error_of([&] { read_scene(drive); }), "calib_imu_to_velo.txt is missing: a drive needs its day's"));
  fs::create_symlink("/etc/hostname", day / "calib_imu_to_velo.txt");
  const std::string linked = error_of([&] { read_scene(drive); });
  CHECK(holds(linked, "calib_imu_to_velo.txt: R is missing"));  // says nothing of what the link leads to
  fs::rename(day / "away", day / "calib_imu_to_velo.txt");
  const Scene scene = read_scene(drive);
  for (const std::size_t size : {1, 15, 17}) {
    write_text(drive / "velodyne_points/data/0000000000.bin", std::string(size, 'x'));
    CHECK(holds(error_of([&] { load_sweep(scene, scene.sweeps[0]); }), "want a multiple of 16"));
  }
}

TEST_CASE("KITTI: linked folders are followed, without boxes and LiDAR it says so, links are not quoted") {
  const Folder folder, other;
  const fs::path drive = write_drive(folder.path);
  fs::rename(drive / "image_02", other.path / "images");
  fs::create_directory_symlink(other.path / "images", drive / "image_02");
  const Scene scene = read_scene(drive);
  CHECK(scene.warnings.empty());
  CHECK(load_images(scene, Split::train).frames.size() == kSteps);
  fs::create_directory_symlink(drive, other.path / "drive");
  CHECK(read_scene(other.path / "drive").frames.size() == kSteps);
  write_text(other.path / "secret", "hunter2 1 2 3 4 5\n");
  fs::rename(drive / "oxts/data/0000000001.txt", other.path / "away");
  fs::create_symlink(other.path / "secret", drive / "oxts/data/0000000001.txt");
  const std::string message = error_of([&] { read_scene(drive); });
  CHECK_MESSAGE(holds(message, "0000000001.txt: the file that this link leads to"), message);
  CHECK_FALSE(holds(message, "hunter2"));
  fs::remove(drive / "oxts/data/0000000001.txt");
  fs::rename(other.path / "away", drive / "oxts/data/0000000001.txt");
  fs::remove(drive / "tracklet_labels.xml");
  fs::remove_all(drive / "velodyne_points");
  CHECK(read_scene(drive).warnings == std::vector<std::string>{"no LiDAR sweeps: looked for velodyne_points/data/*.bin",
                                                               "no boxes of actors: looked for tracklet_labels.xml"});
}

TEST_CASE("KITTI: hostile tracklets") {
  const Folder folder;
  const fs::path drive = write_drive(folder.path), file = drive / "tracklet_labels.xml";
  const auto error_with = [&](const std::string& content) {
    write_text(file, content);
    return error_of([&] { read_scene(drive); });
  };
  const std::string sound = tracklets();
  for (std::size_t size = 0; size + 1 < sound.size(); size += 7) {
    CAPTURE(size);
    CHECK(error_with(sound.substr(0, size)) != "no error");
  }
  CHECK(holds(error_with(tracklets("nan")), "tracklet 000: <h>: looked for a finite number, found 'nan'"));
  CHECK(holds(error_with(tracklets("-1")), "implausible box size"));
  CHECK(holds(error_with(tracklets("")), "<h>"));
  std::string bomb = "<!DOCTYPE b [<!ENTITY a0 \"1\">";
  for (int i = 1; i < 40; ++i) {
    const std::string before = "&a" + std::to_string(i - 1) + ";";
    bomb += "<!ENTITY a" + std::to_string(i) + " \"" + before + before + "\">";
  }
  const std::size_t head = sound.find("<boost");
  CHECK(holds(error_with(bomb + "]>" + tracklets("&a39;").substr(head)), "found '&a39;'"));
  std::string deep;
  for (int i = 0; i < 300000; ++i) deep += "<a>";
  CHECK(holds(error_with(deep), "tracklet_labels.xml: byte"));
  CHECK(holds(read_scene(drive, {true}).warnings.at(0), "tracklets dropped: tracklet_labels.xml: byte"));
}

TEST_CASE("kitti, real data: boxes hold points, and LiDAR fits both cameras") {
  if (no_data(data_folder())) return;
  const Scene scene = read_scene(data_folder());
  CHECK(scene.warnings.empty());
  CHECK(scene.frames.size() == 48);
  CHECK(scene.sweeps.size() == 24);
  CHECK(scene.actors.size() == 13);
  const LogReport report = check_log(scene);
  CHECK(report.warnings.empty());
  CHECK(report.boxes == 215);
  CHECK(report.boxes_without_points == 0);
  REQUIRE(report.fits.size() == 2);
  for (const LidarFit& fit : report.fits) {
    CAPTURE(fit.sensor);
    CHECK(fit.share_worse > 0.97);
    CHECK(std::max(std::abs(fit.offset_x), std::abs(fit.offset_y)) <= 1);
    CHECK(fit.points_per_image > 10000);
  }
}
