// Driving logs in PandaSet's layout: written by us and read back, by pandas too; real-layout logs; what is broken in
// them.
#include "models/data/pandaset.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "models/data/check_log.h"
#include "models/data/data_frame.h"
#include "models/data/load_images.h"
#include "models/data/load_sweep.h"
#include "models/data/read_scene.h"
#include "models/data/write_pandaset.h"
#include "models/scene/split.h"
#include "runtime/error.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

constexpr int kSteps = 3;

Eigen::Matrix4d pose_of(double angle, const Eigen::Vector3d& axis, const Eigen::Vector3d& position) {
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  pose.topLeftCorner<3, 3>() = Eigen::AngleAxisd(angle, axis.normalized()).toRotationMatrix();
  pose.topRightCorner<3, 1>() = position;
  return pose;
}

// Two cameras, three steps, a car that drives and a pedestrian who appears at the second step.
Scene small_log() {
  Scene log;
  log.is_log = log.night = true;
  log.cameras = {{16, 12, 10, 11, 8, 6, CameraModel::pinhole, {}, 0, 0},
                 {20, 10, 9, 9, 10, 5, CameraModel::pinhole, {}, 0, 0}};
  log.actors = {{"a-uuid", "Car", {1.8, 4.5, 1.5}, false, {}}, {"b-uuid", "Pedestrian", {0.6, 0.5, 1.7}, true, {}}};
  for (int step = 0; step < kSteps; ++step) {
    const double time = 1557539924.0 + 0.1 * step;
    for (int camera = 0; camera < 2; ++camera) {
      Frame frame;
      frame.sensor = camera ? "left_camera" : "front_camera";
      frame.step = step;
      frame.camera = camera;
      frame.timestamp = time + 0.01 * camera;
      frame.world_from_camera = pose_of(-1.5 + 0.1 * camera, {1, 0.1, 0.2}, {step + 0.25, camera + 2.0, 1.5});
      log.frames.push_back(frame);
    }
    log.sweeps.push_back({"", time, pose_of(0.1 * step, {0, 0, 1}, {step + 0.5, 2, 1.9}), step, Split::train});
    log.actors[0].boxes.push_back({step, time, pose_of(0.3, {0, 0, 1}, {5.0 + step, 8, 0.75})});
    if (step > 0) log.actors[1].boxes.push_back({step, time, pose_of(-2, {0, 0, 1}, {-3, 9, 0.85})});
  }
  return log;
}

LidarPoints small_points(const Sweep& sweep) {
  LidarPoints points;
  for (int i = 0; i < 10; ++i) {
    for (const double value : {5.0 + sweep.step, 8.0, 0.15 * i}) points.positions.push_back(float(value));
    points.intensities.push_back(float(i) / 255);
    points.times.push_back(0.25f - 0.03125f * float(i));
    points.sensors.push_back(i > 6);
  }
  return points;
}

Image small_image(const Camera& camera) {
  return {camera.width, camera.height, 3,
          std::vector<std::uint8_t>(3 * std::size_t(camera.width) * camera.height, 100)};
}

fs::path written_log(const fs::path& folder) {
  const Scene log = small_log();
  const auto image = [&](const Frame& frame) { return small_image(log.cameras[std::size_t(frame.camera)]); };
  write_pandaset(folder / "log", log, {image, small_points});
  return folder / "log";
}

}  // namespace

TEST_CASE("a log reads back as it was written") {
  const Folder folder;
  const Scene wanted = small_log(), read = read_scene(written_log(folder.path));
  CHECK(read.format == "PandaSet");
  CHECK(read.is_log);
  CHECK(read.metric);
  CHECK(read.night);
  CHECK(read.warnings.empty());
  CHECK(read.cameras == wanted.cameras);
  REQUIRE(read.frames.size() == 2 * kSteps);
  for (const Frame& frame : read.frames) {
    const auto& same = wanted.frames[std::size_t(2 * frame.step + frame.camera)];
    CHECK(frame.sensor == same.sensor);
    CHECK(frame.image == "camera/" + same.sensor + "/0" + std::to_string(frame.step) + ".jpg");
    CHECK(frame.timestamp == same.timestamp);
    CHECK(frame.world_from_camera.isApprox(same.world_from_camera, 1e-12));
  }
  REQUIRE(read.sweeps.size() == kSteps);
  REQUIRE(read.actors.size() == 2);
  for (std::size_t a = 0; a < 2; ++a) {
    const Actor &actor = read.actors[a], &same = wanted.actors[a];
    CHECK(actor.id == same.id);
    CHECK(actor.label == same.label);
    CHECK(actor.size == same.size);
    CHECK(actor.stationary == same.stationary);
    REQUIRE(actor.boxes.size() == same.boxes.size());
    for (std::size_t b = 0; b < actor.boxes.size(); ++b) {
      CHECK(actor.boxes[b].step == same.boxes[b].step);
      CHECK(actor.boxes[b].timestamp == same.boxes[b].timestamp);
      CHECK(actor.boxes[b].world_from_box.isApprox(same.boxes[b].world_from_box, 1e-12));
    }
  }
  const Sweep& sweep = read.sweeps[1];
  CHECK(sweep.timestamp == wanted.sweeps[1].timestamp);
  CHECK(sweep.world_from_lidar.isApprox(wanted.sweeps[1].world_from_lidar, 1e-12));
  const LidarPoints points = load_sweep(read, sweep), same = small_points(sweep);
  CHECK(points.positions == same.positions);
  CHECK(points.intensities == same.intensities);
  CHECK(points.sensors == same.sensors);
  for (std::size_t i = 0; i < points.size(); ++i)
    CHECK(points.times[i] == doctest::Approx(same.times[i]).epsilon(1e-5));
  CHECK(load_images(read, Split::train).frames.size() == 2 * kSteps);
}

TEST_CASE("--holdout in a log takes whole steps, with their sweeps") {
  const Folder folder;
  Scene log = read_scene(written_log(folder.path));
  apply_holdout(log, 2);
  for (const Frame& frame : log.frames) CHECK((frame.split == Split::test) == (frame.step != 1));
  for (const Sweep& sweep : log.sweeps) CHECK((sweep.split == Split::test) == (sweep.step != 1));
}

TEST_CASE("a box of the LiDAR that looks ahead is dropped, as are those that nobody can place") {
  const Folder folder;
  const fs::path log = written_log(folder.path);
  const auto rewrite = [&](const char* column, double value) {
    const fs::path path = log / "annotations/cuboids/01.pkl.gz";
    const DataFrame given = read_data_frame(path);
    DataFrame changed;
    for (Column other : given.columns()) {
      if (other.name == column) other.values = std::vector<double>{value, given.numbers(column)[1]};
      changed.add(other);
    }
    write_data_frame(path, changed);
  };
  rewrite("cuboids.sensor_id", 1);
  CHECK(read_scene(log).actors[0].boxes.size() == kSteps - 1);
  rewrite("cuboids.sensor_id", 0);
  CHECK(read_scene(log).actors[0].boxes.size() == kSteps);
  const Scene sound = read_scene(log);
  rewrite("yaw", std::nan(""));
  CHECK(holds(error_of([&] { read_scene(log); }), "annotations/cuboids/01.pkl.gz, row 0 (a-uuid)"));
  const Scene left = read_scene(log, {true});
  CHECK(left.warnings.size() == 1);
  CHECK(left.actors[0].boxes.size() == kSteps - 1);
  CHECK(left.actors[1].boxes.size() == sound.actors[1].boxes.size());
  rewrite("yaw", 0);
  rewrite("dimensions.y", -1);
  CHECK(holds(error_of([&] { read_scene(log); }), "implausible box size"));
}

TEST_CASE("what is missing in a log is warned of; what is broken is named") {
  const Folder folder;
  const fs::path log = written_log(folder.path);
  fs::remove(log / "camera/left_camera/01.jpg");
  fs::remove(log / "lidar/02.pkl.gz");
  Scene scene = read_scene(log);
  CHECK(scene.frames.size() == 2 * kSteps - 1);
  CHECK(scene.sweeps.size() == kSteps - 1);
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "2 listed files are missing and skipped: camera/left_camera/01.jpg, lidar/02.pkl.gz"));
  fs::remove_all(log / "camera/left_camera");
  fs::remove_all(log / "meta");
  fs::remove_all(log / "annotations");
  scene = read_scene(log);
  CHECK(scene.frames.size() == kSteps);
  CHECK(scene.actors.empty());
  CHECK_FALSE(scene.night);
  const fs::path poses = log / "camera/front_camera/poses.json", times = log / "camera/front_camera/timestamps.json";
  write_text(times, "[1, 2]");
  CHECK(holds(error_of([&] { read_scene(log); }), "camera/front_camera: 3 poses but 2 time stamps"));
  write_text(times, "[1, 2, NaN]");
  CHECK(holds(error_of([&] { read_scene(log); }), "timestamps.json, entry 2"));
  write_text(times, "[1, 2, 3]");
  const std::string sound = R"({"position":{"x":1,"y":2,"z":3},"heading":{"w":1,"x":0,"y":0,"z":0}})";
  for (const char* bad :
       {R"({"position":{"x":NaN,"y":2,"z":3},"heading":{"w":1,"x":0,"y":0,"z":0}})",
        R"({"position":{"x":1e8,"y":2,"z":3},"heading":{"w":1,"x":0,"y":0,"z":0}})",
        R"({"position":{"x":1,"y":2,"z":3},"heading":{"w":2,"x":0,"y":0,"z":0}})", R"({"heading":[1,0,0,0]})", "[]"}) {
    write_text(poses, "[" + sound + "," + bad + "," + sound + "]");
    CHECK(holds(error_of([&] { read_scene(log); }), "camera/front_camera/poses.json, entry 1"));
    CHECK(read_scene(log, {true}).frames.size() == 2);
  }
  write_text(poses, "{}");
  CHECK(holds(error_of([&] { read_scene(log); }), "poses.json: looked for a list"));
  write_text(poses, "[" + sound + "," + sound + "," + sound + "]");
  write_text(log / "camera/front_camera/intrinsics.json", R"({"fx":0,"fy":1,"cx":1,"cy":1})");
  CHECK(holds(error_of([&] { read_scene(log); }), "fx 0"));
  write_text(log / "lidar/01.pkl.gz", "no pickle");
  const Sweep sweep{"lidar/01.pkl.gz", 0, Eigen::Matrix4d::Identity(), 1, Split::train};
  CHECK(holds(error_of([&] { load_sweep(scene, sweep); }), "lidar/01.pkl.gz: byte 0: looked for a pickle"));
}

TEST_CASE("a log whose folders and files are links reads as the log; what a link leads to is not quoted") {
  const Folder folder, other;
  const fs::path log = written_log(folder.path);
  fs::rename(log / "lidar", other.path / "lidar");
  fs::create_directory_symlink(other.path / "lidar", log / "lidar");
  for (const char* file : {"camera/front_camera/00.jpg", "annotations/cuboids/01.pkl.gz", "lidar/02.pkl.gz"}) {
    const std::string blob = std::to_string(std::hash<std::string>()(file));  // no extension, as in caches
    fs::rename(log / file, other.path / blob);
    fs::create_symlink(other.path / blob, log / file);
  }
  const Scene scene = read_scene(log);
  CHECK(scene.warnings.empty());
  CHECK(scene.actors.size() == 2);
  CHECK(load_images(scene, Split::train).frames.size() == 2 * kSteps);
  for (const Sweep& sweep : scene.sweeps) CHECK(load_sweep(scene, sweep).size() == 10);
  // A pickle that asks for a class of that name.
  write_text(other.path / "secret", "chunter2\nsecond line\n.");
  fs::remove(log / "annotations/cuboids/01.pkl.gz");
  fs::create_symlink(other.path / "secret", log / "annotations/cuboids/01.pkl.gz");
  const std::string message = error_of([&] { read_scene(log); });
  CHECK_MESSAGE(holds(message, "01.pkl.gz: the file that this link leads to"), message);
  CHECK_FALSE(holds(message, "hunter2"));
}

TEST_CASE("a log without LiDAR, boxes, or a camera's poses says what it looked for") {
  const Folder folder;
  const fs::path log = written_log(folder.path);
  fs::remove_all(log / "lidar");
  fs::remove_all(log / "annotations");
  fs::remove(log / "camera/left_camera/poses.json");
  fs::create_directories(log / "camera/frontcamera");
  const std::vector<std::string> warnings = read_scene(log).warnings;
  REQUIRE(warnings.size() == 4);
  CHECK(warnings[0] == "camera/frontcamera is left out: PandaSet has no camera of that name");
  CHECK(warnings[1] == "camera/left_camera is left out: it has no poses.json");
  CHECK(warnings[2] == "no LiDAR sweeps: looked for lidar/poses.json");
  CHECK(warnings[3] == "no boxes of actors: looked for annotations/cuboids/*.pkl.gz");
}

TEST_CASE("points that are no numbers are counted and dropped") {
  const Folder folder;
  const Scene log = read_scene(written_log(folder.path));
  DataFrame frame;
  for (const char* name : {"x", "y", "z", "i", "t"}) frame.add({name, std::vector<double>{1, 2, 3, 4}});
  DataFrame broken;
  for (Column column : frame.columns()) {
    if (column.name == "y") column.values = std::vector<double>{11, std::nan(""), INFINITY, 1e9};
    broken.add(column);
  }
  write_data_frame(log.root / "lidar/00.pkl.gz", broken);
  const LidarPoints points = load_sweep(log, log.sweeps[0]);
  CHECK(points.size() == 1);
  CHECK(points.dropped == 3);
}

TEST_CASE("returns of the recording car are left out of sweeps") {
  const Folder folder;
  const Scene log = read_scene(written_log(folder.path));
  const Eigen::Vector3d lidar = log.sweeps[0].world_from_lidar.block<3, 1>(0, 3);
  // On the bonnet; on the road beyond it; on a sign above.
  const std::vector<Eigen::Vector3d> places = {{0, 2.4, -1}, {0, 2.6, -1.8}, {0, 1, 3}};
  DataFrame frame;
  const char* const axes[] = {"x", "y", "z"};
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> column;
    for (const Eigen::Vector3d& place : places) column.push_back(lidar[axis] + place[axis]);
    frame.add({axes[axis], column});
  }
  for (const char* name : {"i", "t"}) frame.add({name, std::vector<double>{0, 0, 0}});
  write_data_frame(log.root / "lidar/00.pkl.gz", frame);
  const LidarPoints points = load_sweep(log, log.sweeps[0]);
  CHECK(points.of_ego == 1);
  REQUIRE(points.size() == 2);
  CHECK(points.positions[1] == doctest::Approx(lidar.y() + 2.6));
  CHECK(points.positions[5] == doctest::Approx(lidar.z() + 3));
}

TEST_CASE("check_log: time stamps, boxes without points") {
  const Folder folder;
  Scene log = read_scene(written_log(folder.path));
  LogReport report = check_log(log);
  CHECK(report.warnings.empty());
  CHECK(report.steps == kSteps);
  CHECK(report.rate == doctest::Approx(10).epsilon(1e-3));
  CHECK(report.boxes == 5);
  CHECK(report.boxes_without_points == 2);  // no point is on the pedestrian
  for (Frame& frame : log.frames) *frame.timestamp += 0.35;
  log.sweeps[2].timestamp = log.sweeps[1].timestamp;
  report = check_log(log);
  REQUIRE(report.warnings.size() == 3);
  CHECK(holds(report.warnings[0], "front_camera: its images are taken 0.3"));
  CHECK(holds(report.warnings[2], "lidar: 0 s from step 1 to step 2: time stamps must increase"));
}

TEST_CASE("pandaset-mini: all logs, and LiDAR that fits the images") {
  if (no_data(test_data("pandaset-mini"))) return;
  for (int number = 1; number <= 8; ++number) {
    const Scene log = read_scene(test_data("pandaset-mini") / ("00" + std::to_string(number)));
    CAPTURE(number);
    CHECK(log.warnings.empty());
    CHECK(log.frames.size() == 120);
    CHECK(log.sweeps.size() == 20);
    CHECK(log.actors.size() > 5);
    CHECK(log.night == (number == 3 || number == 7));
    const LidarPoints points = load_sweep(log, log.sweeps[10]);
    CHECK(points.size() > 10000);
    CHECK(points.dropped == 0);
  }
}

TEST_CASE("check_log sees a camera that is turned, and no other") {
  if (no_data(test_data("pandaset-mini"))) return;
  Scene log = read_scene(test_data("pandaset-mini") / "001");
  LogReport report = check_log(log);
  CHECK(report.warnings.empty());
  REQUIRE(report.fits.size() == 6);
  for (const LidarFit& fit : report.fits) {
    CAPTURE(fit.sensor);
    CHECK(fit.share_worse > 0.97);
    CHECK(std::max(std::abs(fit.offset_x), std::abs(fit.offset_y)) <= 1);
    CHECK(fit.points_per_image > 500);
  }
  // Half a degree is 3 pixels of the front camera.
  for (Frame& frame : log.frames) {
    if (frame.sensor == "front_camera") frame.world_from_camera *= pose_of(0.0091, {0, 1, 0}, {0, 0, 0});
  }
  report = check_log(log);
  REQUIRE(report.warnings.size() == 1);
  CHECK(holds(report.warnings[0], "front_camera: LiDAR points fit the images better when moved by"));
  CHECK(std::abs(report.fits[1].offset_x) == doctest::Approx(3).epsilon(0.4));
  CHECK(report.fits[1].share_worse < 0.95);
}

TEST_CASE("pandas reads every pickle of a log that we write") {
  if (std::system("/usr/bin/python3 -c 'import pandas' >/dev/null 2>&1") != 0) {
    MESSAGE("skipped: no pandas (apt-get install python3-pandas)");
    return;
  }
  const Folder folder;
  written_log(folder.path);
  write_text(folder.path / "program.py", R"(
import glob
import pandas as pd
sweeps = [pd.read_pickle(name) for name in sorted(glob.glob('log/lidar/*.pkl.gz'))]
boxes = [pd.read_pickle(name) for name in sorted(glob.glob('log/annotations/cuboids/*.pkl.gz'))]
assert [len(s) for s in sweeps] == [10] * 3 and list(sweeps[0].columns) == list('xyzitd')
assert len(sweeps[0][sweeps[0].d == 0]) == 7
assert [list(b.label) for b in boxes] == [['Car']] + [['Car', 'Pedestrian']] * 2
assert abs(boxes[1].yaw[1] + 2) < 1e-12 and boxes[1]['position.x'][0] == 6
assert list(boxes[0]['cuboids.sensor_id']) == [-1] and not boxes[0].stationary[0]
)");
  CHECK(std::system(("cd " + folder.path.string() + " && /usr/bin/python3 program.py").c_str()) == 0);
}
