// A log that is written in PandaSet's layout with cameras and boxes that its own files cannot hold: read again, all
// that was changed is changed, and all else is what it was.
#include "models/runs/recorded_log.h"

#include <doctest/doctest.h>

#include "models/data/load_images.h"
#include "models/data/load_sweep.h"
#include "models/data/read_scene.h"
#include "models/data/refined_log.h"
#include "models/scene/pose.h"
#include "models/synth/street_log.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"
#include "tests/models/told.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// Like the real PandaSet: its sweeps take their poses from the front camera, and photos are stamped late.
Scene recorded_street(const fs::path& folder) {
  StreetLogOptions options;
  options.cameras = {"front_camera", "back_camera"};
  options.frames = 3, options.width = 48, options.height = 27, options.beams = 4, options.as_recorded = true;
  options.truth = false;
  write_street_log(folder, options);
  return read_scene(folder);
}

Scene moved(Scene log) {
  const Eigen::Matrix4d by = pose_from(turn_about_z(0.02), {0.3, -0.4, 0.05});  // too far for its LiDAR
  for (Frame& frame : log.frames)
    if (frame.step == 1) frame.world_from_camera = frame.world_from_camera * by;
  log.cameras[0] = with_lens(log.cameras[0], {1.1, {0.05, -0.02}});
  log.actors.at(0).boxes.at(0).world_from_box.topRightCorner<3, 1>() += Eigen::Vector3d(0.3, 0.1, 0);
  return log;
}

}  // namespace

TEST_CASE("a log whose sweeps follow the front camera is written with other cameras, and its sweeps stay") {
  const Folder folder;
  const Scene given = recorded_street(folder.path / "given");
  REQUIRE(given.recording.front_from_lidar);
  REQUIRE(given.recording.image_stamp != 0);
  CHECK_FALSE(has_room_for({{}, {{"any", Eigen::Matrix4d::Identity()}}, {}}, given));
  CHECK_FALSE(has_room_for({{}, {}, {{"front_camera", {1.1, {0, 0}}}}}, given));
  CHECK(has_room_for({given.actors, {}, {}}, given));

  Told told;
  const Scene wanted = moved(given);
  write_recorded_log(folder.path / "again", wanted, false, told.listener());
  CHECK(told.warned.empty());
  const Scene again = read_scene(folder.path / "again");
  REQUIRE(again.frames.size() == 6);
  for (std::size_t i = 0; i < again.frames.size(); ++i) {
    const Frame &is = again.frames[i], &was = wanted.frames[i];
    CHECK((is.world_from_camera - was.world_from_camera).norm() < 1e-9);
    CHECK(*is.timestamp == doctest::Approx(*was.timestamp).epsilon(1e-12));
    CHECK(is.ego_rows == was.ego_rows);
    const Camera a = again.cameras[std::size_t(is.camera)], b = wanted.cameras[std::size_t(was.camera)];
    CHECK(a.fx == doctest::Approx(b.fx));
    CHECK(a.cx == doctest::Approx(b.cx));
    CHECK(a.cy == doctest::Approx(b.cy));
    CHECK(content_of(again.root / is.image) == content_of(given.root / given.frames[i].image));
  }
  REQUIRE(again.sweeps.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    const Sweep &is = again.sweeps[i], &was = given.sweeps[i];
    CHECK((is.world_from_lidar - was.world_from_lidar).norm() < 1e-9);
    CHECK((*is.velocity - *was.velocity).norm() < 1e-6);
    CHECK(is.timestamp == doctest::Approx(was.timestamp).epsilon(1e-12));
    const LidarPoints a = load_sweep(again, is), b = load_sweep(given, was);
    CHECK(a.positions == b.positions);
    CHECK(a.intensities == b.intensities);
    CHECK(a.sensors == b.sensors);
    REQUIRE(a.times.size() == b.times.size());
    for (std::size_t t = 0; t < a.times.size(); ++t) CHECK(std::abs(a.times[t] - b.times[t]) < 1e-5);
  }
  REQUIRE(again.actors.size() == given.actors.size());
  for (std::size_t a = 0; a < again.actors.size(); ++a) {
    CHECK(again.actors[a].label == wanted.actors[a].label);
    CHECK(again.actors[a].size == wanted.actors[a].size);
    REQUIRE(again.actors[a].boxes.size() == wanted.actors[a].boxes.size());
    for (std::size_t b = 0; b < again.actors[a].boxes.size(); ++b)
      CHECK((again.actors[a].boxes[b].world_from_box - wanted.actors[a].boxes[b].world_from_box).norm() < 1e-9);
  }
}

TEST_CASE("a log that is written in part is removed; one that has no place is told before") {
  const Folder folder;
  Scene log = recorded_street(folder.path / "given");
  const fs::path out = folder.path / "out";
  Told told;
  told.stop_after = 4;
  std::string stopped;
  try {
    write_recorded_log(out, log, false, told.listener());
  } catch (const Interrupted& interrupted) { stopped = interrupted.what(); }
  // How many, depends on the threads.
  CHECK_MESSAGE(holds(stopped, " of 9 photos and sweeps were written"), stopped);
  CHECK_MESSAGE(holds(stopped, "has been removed"), stopped);
  CHECK_FALSE(fs::exists(out));

  Told more;
  const auto write = [&](const fs::path& where, bool skip_bad = false) {
    write_recorded_log(where, log, skip_bad, more.listener());
  };
  CHECK(holds(error_of([&] { write(log.root); }, Fault::usage), "exists; name a new folder"));
  const std::vector<Frame> frames = log.frames;
  for (int camera = 0; camera < 6; ++camera)
    (log.frames.emplace_back(frames.back())).sensor = "camera_" + std::to_string(camera);
  CHECK(holds(error_of([&] { write(out); }, Fault::usage), "has six cameras, the log has 8"));
  CHECK_FALSE(fs::exists(out));

  log.frames = frames;
  log.frames[1].mask = "mask.png";  // is not looked at
  write_text(log.root / log.sweeps[0].file, "no sweep");
  CHECK(holds(error_of([&] { write(out); }), log.sweeps[0].file));  // after all photos
  CHECK_FALSE(fs::exists(out));
  write_text(log.root / log.frames[2].image, "no photo");
  CHECK(holds(error_of([&] { write(out); }), log.frames[2].image));
  write(out, true);
  CHECK_MESSAGE(holds(more.warned, "1 masks are left out"), more.warned);
  CHECK_MESSAGE(holds(more.warned, log.frames[2].image), more.warned);
  CHECK_MESSAGE(holds(more.warned, "sweep dropped"), more.warned);
  const Scene again = read_scene(out);
  CHECK(again.frames.size() == 5);
  CHECK(again.sweeps.size() == 2);
}
