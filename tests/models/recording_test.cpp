// Logs with the clock of real ones (synth --as-recorded): what the reader makes of them, held to the street that they
// were made of, in which everyone goes evenly along a known line. Beside it, what a reader makes that takes each stamp
// as it stands: the same log without meta/recording.json.
#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "models/data/load_sweep.h"
#include "models/data/read_scene.h"
#include "models/data/recording_file.h"
#include "models/scene/pose.h"
#include "models/synth/as_recorded.h"
#include "models/synth/street_layout.h"
#include "models/synth/street_log.h"
#include "models/synth/street_sensors.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;
using Eigen::Matrix4d;
using Eigen::Vector3d;

namespace {

constexpr double kStart = 1557539924;
constexpr int kFrames = 6;
const Vector3d kSecond(0.4, 1.2, -0.4);

StreetLogOptions options_of(bool dead_lidar) {
  StreetLogOptions options;
  options.cameras = {"front_camera", "front_left_camera", "back_camera"};
  options.frames = kFrames;
  options.width = 64;
  options.height = 36;
  options.seed = 11;
  options.truth = false;
  options.as_recorded = true;
  options.dead_lidar = dead_lidar;
  return options;
}

const MadeStreet& street() {
  static const MadeStreet made = make_street(11, {}, 0.1 * kFrames);
  return made;
}

/// Written once for all cases; `known`: with meta/recording.json.
Scene recorded(bool dead_lidar, bool known = true) {
  static const Folder folder;
  const fs::path root = folder.path / (std::string(dead_lidar ? "dead" : "sound") + (known ? "" : "_before"));
  if (!fs::exists(root)) {
    write_street_log(root, options_of(dead_lidar));
    if (!known) fs::remove(root / kRecordingFile);
  }
  return read_scene(root);
}

/// When the middle row of a frame is exposed, in seconds of the street.
double exposure_of(const Frame& frame) { return 0.1 * frame.step - 0.1 * mount_of(frame.sensor).yaw / (2 * M_PI); }

const StreetActor& made_actor(const std::string& id) {
  const auto& actors = street().world.actors;
  return *std::find_if(actors.begin(), actors.end(), [&](const StreetActor& actor) { return actor.id == id; });
}

/// Metres along the ground between an actor's box and where the actor is at a time of the street.
double error_of(const Matrix4d& world_from_box, const Actor& actor, double time) {
  const Vector3d truth = made_actor(actor.id).at(street().world.course, time, 0, 0).position;
  return (world_from_box.topRightCorner<3, 1>() - truth).head<2>().norm();
}

/// The worst of the actors that an image may show, when it is exposed.
double worst_actor(const Scene& log) {
  double worst = 0;
  int compared = 0;
  for (const Frame& frame : log.frames) {
    if (frame.step == 0 || frame.step == kFrames - 1)
      continue;  // actors stand before their first box, and after the last
    for (const Actor& actor : log.actors) {
      const auto pose = world_from_box_at(actor, frame.timestamp.value());
      if (!pose) continue;
      const Vector3d seen = (frame.world_from_camera.inverse() * pose->col(3)).head<3>();
      if (seen.z() > std::abs(seen.x()))
        worst = std::max(worst, error_of(*pose, actor, exposure_of(frame))), ++compared;
    }
  }
  CHECK(compared > 50);
  return worst;
}

/// The share of returns whose ray meets something else in the street than the return itself, when it was seen.
double missed_returns(const Scene& log, int sensor) {
  int missed = 0, all = 0;
  for (const Sweep& sweep : log.sweeps) {
    const LidarPoints points = load_sweep(log, sweep);
    std::map<double, StreetMoment> moments;
    for (std::size_t i = 0; i < points.size(); i += 7) {
      if (points.sensors[i] != sensor) continue;
      const SeenFrom from = seen_from(sweep, sensor, double(points.times[i]));
      const Vector3d way = Eigen::Map<const Eigen::Vector3f>(&points.positions[3 * i]).cast<double>() - from.origin;
      const StreetMoment& now = moments.try_emplace(from.time, street().world, from.time - kStart).first->second;
      const auto seen = now.nearest({from.origin, way.normalized()}, 0.002);
      missed += !seen || std::abs(seen->distance - way.norm()) > 0.15;
      ++all;
    }
  }
  CHECK(all > 500);
  return double(missed) / all;
}

}  // namespace

TEST_CASE("as recorded: images have the pose and the time of their middle rows") {
  for (const Frame& frame : recorded(false).frames) {
    CAPTURE(frame.name);
    CHECK(std::abs(*frame.timestamp - kStart - exposure_of(frame)) < 1e-6);
    const Matrix4d truth = world_from_camera(street(), mount_of(frame.sensor), exposure_of(frame));
    CHECK((frame.world_from_camera - truth).cwiseAbs().maxCoeff() < 2e-3);
    CHECK(frame.ego_rows == doctest::Approx(frame.sensor == "back_camera" ? 260.0 / 1080 : 0));
  }
}

TEST_CASE("as recorded: boxes have the times at which the LiDAR passed them, whatever its poses") {
  for (const bool dead_lidar : {false, true}) {
    const Scene log = recorded(dead_lidar);
    double least = 1, most = 0, worst = 0;
    for (const Actor& actor : log.actors) {
      for (const ActorBox& box : actor.boxes) {
        const double after = box.timestamp - log.sweeps[std::size_t(box.step)].timestamp;
        least = std::min(least, after), most = std::max(most, after);
        worst = std::max(worst, error_of(box.world_from_box, actor, box.timestamp - kStart));
      }
    }
    CHECK(worst < 0.02);
    CHECK(least < -0.02);
    CHECK(most > 0.02);
    CHECK(worst_actor(log) < 0.03);
  }
  CHECK(worst_actor(recorded(false, false)) > 0.4);  // as each stamp says
}

TEST_CASE("as recorded: both LiDARs saw their returns from where they were at the time") {
  for (const bool dead_lidar : {false, true}) {
    const Scene log = recorded(dead_lidar);
    CHECK(log.recording.poses_replaced == (dead_lidar ? kFrames : 0));
    REQUIRE(log.sweeps.size() == kFrames);
    for (const Sweep& sweep : log.sweeps) {
      CHECK(std::abs(sweep.timestamp - kStart - 0.1 * sweep.step) < 1e-6);
      for (const double after : {-0.05, 0.0, 0.04}) {
        const Matrix4d truth = world_from_lidar(street(), 0.1 * sweep.step + after);
        CHECK((seen_from(sweep, 0, after).origin - truth.topRightCorner<3, 1>()).norm() < 0.01);
        CHECK((seen_from(sweep, 1, after).origin - (truth * kSecond.homogeneous()).head<3>()).norm() < 0.01);
      }
    }
    for (const int sensor : {0, 1}) CHECK(missed_returns(log, sensor) < 0.03);
  }
  for (const int sensor : {0, 1}) CHECK(missed_returns(recorded(true, false), sensor) > 0.08);
}

TEST_CASE("as recorded: returns of the car itself are left out, and no others") {
  const Scene log = recorded(false), before = recorded(false, false);
  const CarBox car = *log.recording.car;
  std::size_t of_ego = 0;
  for (std::size_t i = 0; i < log.sweeps.size(); ++i) {
    const LidarPoints points = load_sweep(log, log.sweeps[i]), all = load_sweep(before, before.sweeps[i]);
    of_ego += points.of_ego;
    // What the street's own things sent back is there: on the car is nothing but the car.
    for (std::size_t p = 0; p < points.size(); ++p) {
      const Matrix4d lidar = world_from_lidar(street(), 0.1 * double(i) + double(points.times[p]));
      const Vector3d place = Eigen::Map<const Eigen::Vector3f>(&points.positions[3 * p]).cast<double>();
      const Vector3d local = (lidar.inverse() * place.homogeneous()).head<3>();
      CHECK(((local - car.centre).cwiseAbs() - 0.5 * car.size).maxCoeff() > -0.02);
    }
    CHECK(points.size() + points.of_ego == all.size() + all.of_ego);
  }
  CHECK(of_ego > 300);
}

TEST_CASE("returns of the car itself are told from others by where the car was when it was hit") {
  const Folder folder;
  const double after = 0.08;
  std::ofstream(folder.path / "sweep.ply") << "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\n"
                                              "property float y\nproperty float z\nproperty float intensity\n"
                                              "property float time\nend_header\n"
                                           << "102 0 1 0.5 0.08\n"  // the bonnet, 4 m on since the sweep's stamp
                                           << "98 0 1 0.5 0.08\n";  // where the boot was then, and is no more
  Sweep sweep;
  sweep.file = "sweep.ply";
  sweep.world_from_lidar.topRightCorner<3, 1>() = Vector3d(96.5, 0, 2);
  sweep.velocity = Vector3d(4 / after, 0, 0);
  Scene log;
  log.root = folder.path;
  log.recording.car = CarBox{{0, 0, -1}, {4, 2, 1}};
  const LidarPoints points = load_sweep(log, sweep);
  CHECK(points.of_ego == 1);
  REQUIRE(points.size() == 1);
  CHECK(points.positions[0] == 98);
}

TEST_CASE("a log whose sensors see all at once is read as ever") {
  const Folder folder;
  StreetLogOptions options = options_of(false);
  options.as_recorded = false;
  write_street_log(folder.path / "001", options);
  CHECK_FALSE(fs::exists(folder.path / "001" / kRecordingFile));
  const Scene log = read_scene(folder.path / "001");
  CHECK(log.recording == Recording{});
  for (const Sweep& sweep : log.sweeps) {
    CHECK_FALSE(sweep.velocity);
    const SeenFrom from = seen_from(sweep, 0, 0.04);
    CHECK(from.time == sweep.timestamp);
    CHECK(from.origin == sweep.world_from_lidar.topRightCorner<3, 1>());
  }
  for (const Actor& actor : log.actors)
    for (const ActorBox& box : actor.boxes) CHECK(box.timestamp == log.sweeps[std::size_t(box.step)].timestamp);
}

TEST_CASE("a rolling shutter is told, and its boxes have times of their own") {
  const Folder folder;
  StreetLogOptions options = options_of(false);
  options.as_recorded = false;
  options.rolling_shutter = true;
  write_street_log(folder.path / "001", options);
  const Scene log = read_scene(folder.path / "001");
  CHECK(log.recording.shutter == 0.03);
  double worst = 0;
  for (const Actor& actor : log.actors)
    for (const ActorBox& box : actor.boxes)
      worst = std::max(worst, error_of(box.world_from_box, actor, box.timestamp - kStart));
  CHECK(worst < 0.02);
  CHECK(missed_returns(log, 0) < 0.03);
}

TEST_CASE("an actor that crosses the seam of the sweeps is where it was seen, on either side") {
  const auto at = [](int step, double time) {
    return ActorBox{step, time, pose_from(Eigen::Matrix3d::Identity(), {10 * time, 0, 0})};
  };
  const Actor slower{"a", "Car", {1, 1, 1}, false, {at(0, 0.05), at(1, 0.15), at(2, 0.15 + 1e-3), at(3, 0.25)}};

  const Actor faster{"b", "Car", {1, 1, 1}, false, {at(0, -0.05), at(1, 0.05), at(2, 0.25), at(3, 0.35)}};
  for (const double time : {0.08, 0.12, 0.2}) {
    for (const Actor* actor : {&slower, &faster}) {
      const auto pose = world_from_box_at(*actor, time);
      REQUIRE(pose);
      CHECK((*pose)(0, 3) == doctest::Approx(10 * time));
    }
  }
  const Actor gap{"c", "Car", {1, 1, 1}, false, {at(0, 0), at(1, 0.1), at(3, 0.3), at(4, 0.4)}};
  CHECK_FALSE(world_from_box_at(gap, 0.2));
}

TEST_CASE("recordings are written as they are, and what no log has is told") {
  Recording all = recording_of(options_of(false));
  all.shutter = 0.03;
  all.ahead = {0, -1, 0};
  all.lidar_poses_wrong = true;
  all.poses_replaced = 3;
  for (const Recording& recording : {all, Recording{}, pandaset_recording()})
    CHECK(recording_from(parse_json(to_json(recording).dump(), "it"), "it") == recording);
  const auto error_of_text = [](const char* given) {
    return cloam::error_of([&] { recording_from(parse_json(given, "it"), "it"); });
  };
  CHECK(holds(error_of_text("[]"), "looked for an object"));
  CHECK(holds(error_of_text(R"({"sweep_seconds": 5})"), "\"sweep_seconds\" is 5"));
  CHECK(holds(error_of_text(R"({"rolling_shutter_seconds": -0.1})"), "less than 0"));
  CHECK(holds(error_of_text(R"({"ahead": [0, 0, 1]})"), "no direction along the ground"));
  CHECK(holds(error_of_text(R"({"second_lidar": [0, 1]})"), "three numbers"));
  CHECK(holds(error_of_text(R"({"car": {"centre": [0, 0, 0], "size": [1, 0, 1]}})"), "no size"));
  CHECK(holds(error_of_text(R"({"car_rows": {"back_camera": 1}})"), "share of the rows"));
}

TEST_CASE("PandaSet's own LiDARs: the second stands before the first") {
  const Recording real = pandaset_recording();
  CHECK(real.second_lidar->dot(real.ahead) == doctest::Approx(0.6).epsilon(0.05));
  // The front camera looks ahead, upright.
  const Eigen::Matrix3d turn = real.front_from_lidar->topLeftCorner<3, 3>();
  CHECK((turn * real.ahead).z() > 0.99);
  CHECK((turn * Vector3d::UnitZ()).y() < -0.99);
}
