// cloam edit: what is asked for is what the new run holds; mistakes are told with the words that would do.
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <numbers>

#include "models/io/checkpoint.h"
#include "models/runs/restore_run.h"
#include "models/runs/scene_file.h"
#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;
using Eigen::Vector3d;

namespace {

Scene log_with(const std::vector<std::string>& ids) {
  Scene log;
  log.is_log = true;
  log.cameras = {{16, 12, 10, 10, 8, 6, CameraModel::pinhole, {}, 0, 0}};
  for (const std::string& id : ids) log.actors.push_back({id, "Car", {2, 4, 1.5}, true, {}});
  for (int step = 0; step < 3; ++step) {
    Frame frame;
    frame.image = "camera/front_camera/0" + std::to_string(step) + ".jpg";
    frame.name = frame.image;
    frame.sensor = "front_camera";
    frame.step = step;
    frame.timestamp = 0.1 * step;
    log.frames.push_back(frame);
    for (Actor& actor : log.actors) {
      Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
      pose.topLeftCorner<3, 3>() = Eigen::AngleAxisd(std::numbers::pi / 2, Vector3d::UnitZ()).toRotationMatrix();
      pose.topRightCorner<3, 1>() = Vector3d(step, 5, 0.75);
      actor.boxes.push_back({step, 0.1 * step, pose});
    }
  }
  return log;
}

/// A run of two logs. Editing needs neither its images nor a device.
fs::path street_run(const std::string& name) {
  const RunPaths run{scratch() / name};
  RunRecord record;
  record.state = "finished";
  record.method = record.preset = "genassets";
  record.data = {{"logs/001", "../logs/001", "x"}, {"logs/002", "../logs/002", "y"}};
  record.settings = {{"a.setting", "7"}};
  Scenes scenes = {log_with({"abc-1", "abd-2", "x"}), log_with({"abc-1", "truck-9"})};
  scenes[1].actors[1].size = Vector3d(2.5, 8, 3);
  scenes[1].actors[1].label = "Truck";
  write_scenes(run.scene(), scenes);
  SafetensorsFile file;
  file.metadata = checkpoint_metadata(record);
  file.metadata["seed"] = std::to_string(record.seed);
  save_checkpoint(run.checkpoints(), 12, file);
  write_record(run.root, record);
  return run.root;
}

Outcome edit(const fs::path& run, const Words& actors, const fs::path& out) {
  Words words = {"edit", run.string(), "-o", out.string()};
  for (const std::string& actor : actors) words.insert(words.end(), {"--actor", actor});
  return cloam_with(words);
}

Vector3d centre(const Scenes& scenes, std::size_t log, std::size_t actor, std::size_t box) {
  return scenes[log].actors[actor].boxes.at(box).world_from_box.topRightCorner<3, 1>();
}

}  // namespace

TEST_CASE("edit writes a run of its own, and edits of edits compose") {
  const fs::path run = street_run("to-edit"), once = scratch() / "once", twice = scratch() / "twice";
  const auto before = snapshot(run);
  const Outcome first = edit(run, {"0:abc:shift=1,2,0,rotate=90", "1:abc:remove", "002:truck:shift=0/-1/0.5"}, once);
  REQUIRE_MESSAGE(first.code == 0, first.err);
  CHECK(snapshot(run) == before);
  Scenes scenes = read_scene_file(RunPaths{once}.scene());
  CHECK((centre(scenes, 0, 0, 2) - Vector3d(0, 6, 0.75)).norm() < 1e-12);  // it looks along -x, its right is +y
  CHECK(scenes[0].actors[0].boxes[0].world_from_box.block<3, 1>(0, 1).isApprox(Vector3d(0, -1, 0)));
  CHECK(scenes[1].actors[0].id == "abc-1");
  CHECK(scenes[1].actors[0].boxes.empty());
  CHECK((centre(scenes, 1, 1, 0) - Vector3d(1, 5, 1.25)).norm() < 1e-12);
  CHECK((centre(scenes, 0, 1, 0) - Vector3d(0, 5, 0.75)).norm() == 0);

  write_text(scratch() / "drive.csv", "time,x,y,z,yaw\n0.1,3,4,5,0\n0.2,4,4,5,1\n");
  const Outcome second = edit(once, {"x:replace=1:truck-9", "1:c-1:path=" + (scratch() / "drive.csv").string()}, twice);
  REQUIRE_MESSAGE(second.code == 0, second.err);
  fs::remove_all(run);
  fs::remove_all(once);
  scenes = read_scene_file(RunPaths{twice}.scene());
  CHECK(scenes[0].actors[2].asset == AssetName{1, "truck-9"});
  CHECK(scenes[0].actors[2].size == Vector3d(2.5, 8, 3));
  CHECK(centre(scenes, 0, 2, 0).z() == doctest::Approx(1.5));
  CHECK(scenes[1].actors[0].boxes.size() == 2);
  CHECK(centre(scenes, 1, 0, 1).x() == 4);
  CHECK((centre(scenes, 0, 0, 2) - Vector3d(0, 6, 0.75)).norm() < 1e-12);
  CHECK(load_latest_checkpoint(RunPaths{twice}.checkpoints()).step == 12);
  CHECK(content_of(RunPaths{twice}.checkpoints() / "latest.txt") == "000012.safetensors\n");
  const RunRecord record = read_record(twice);
  CHECK(record.edited_from->given == once.string());
  CHECK(record.data[1].relative == "../logs/002");
  CHECK(record.settings.at("a.setting") == "7");
  const Outcome resumed = cloam_with({"train", "--resume", twice.string()});
  CHECK(resumed.code == 2);
  CHECK_MESSAGE(contains(resumed.err, "is an edited run"), resumed.err);
}

TEST_CASE("edit's mistakes: one line that says what would do, and nothing is written") {
  const fs::path run = street_run("mistaken"), out = scratch() / "never";
  const std::pair<const char*, const char*> cases[] = {
      {"abc:remove", "'abc' matches 2 actors: 0:abc-1, 1:abc-1; give more of the id"},
      {"trukc:remove", "did you mean 1:truck-9?"},
      {"x:shfit=1,0,0", "did you mean shift?"},
      {"x:shift=1,0", "want 3 numbers, found 2"},
      {"x", "example: --actor 3f2a:shift=2,0,0"},
      {"x:remove,shift=1,0,0", "no boxes to move"},
  };
  for (const auto& [given, told] : cases) {
    const Outcome outcome = edit(run, {given}, out);
    CHECK_MESSAGE(outcome.code == 2, given, ": ", outcome.err);
    CHECK_MESSAGE(contains(outcome.err, told), given, ": ", outcome.err);
  }
  CHECK(edit(run, {"x:path=" + (scratch() / "absent.csv").string()}, out).code == 3);
  CHECK_FALSE(fs::exists(out));
  CHECK(edit(run, {"x:remove"}, run).code == 2);  // never over a run
  write_text(RunPaths{run}.checkpoints() / "000012.safetensors", "damaged");
  CHECK(edit(run, {"x:remove"}, out).code == 3);
  CHECK_FALSE(is_run(out));
}
