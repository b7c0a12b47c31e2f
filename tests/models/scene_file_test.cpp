// scene.json and the file of boxes beside it. What else scene.json keeps is in trainer_test.cpp.
#include "models/runs/scene_file.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <nlohmann/json.hpp>

#include "models/io/json.h"
#include "models/runs/box_file.h"
#include "runtime/error.h"
#include "tests/models/folder.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// Scenes with that many boxes in all, in tracks of 80, and one actor that has none. Poses are no round numbers.
Scenes scenes_of_boxes(int count, int scenes) {
  constexpr int kSteps = 80;
  Scenes all(static_cast<std::size_t>(scenes));
  for (Scene& scene : all) {
    scene.is_log = true;
    scene.cameras = {{16, 12, 10, 11, 8, 6}};
    scene.frames = {Frame{}};
    scene.actors = {{"0", "Car", {2, 4, 1.5}, true, {}, {}, true}};
  }
  for (int box = 0; box < count; ++box) {
    const int track = box / kSteps, step = box % kSteps;
    auto& actors = all[static_cast<std::size_t>(track) % all.size()].actors;
    if (step == 0) actors.push_back({std::to_string(track), "Bus", {3, 9 + 1.0 / (1 + track), 3}, false, {}, {}});
    Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
    pose.topLeftCorner<2, 2>() = Eigen::Rotation2D<double>(0.37 * box).toRotationMatrix();
    pose(0, 3) = box / 3.0;
    actors.back().boxes.push_back({step, 1557539924.0 + 0.1 * step + 1e-7 * track, pose});
  }
  return all;
}

bool same_box(const ActorBox& a, const ActorBox& b) {
  return a.step == b.step && a.timestamp == b.timestamp && a.world_from_box == b.world_from_box;
}

std::size_t boxes_that_differ(const Scenes& a, const Scenes& b) {
  std::size_t differ = 0;
  REQUIRE(a.size() == b.size());
  for (std::size_t s = 0; s < a.size(); ++s) {
    REQUIRE(a[s].actors.size() == b[s].actors.size());
    for (std::size_t i = 0; i < a[s].actors.size(); ++i) {
      const Actor &x = a[s].actors[i], &y = b[s].actors[i];
      REQUIRE(x.boxes.size() == y.boxes.size());
      differ += x.id != y.id || x.size != y.size || x.stationary != y.stationary || x.follows_path != y.follows_path;
      for (std::size_t k = 0; k < x.boxes.size(); ++k) differ += !same_box(x.boxes[k], y.boxes[k]);
    }
  }
  return differ;
}

std::string error_of_reading(const fs::path& scene_json) {
  try {
    read_scene_file(scene_json);
  } catch (const Error& error) {
    CHECK(error.fault() == Fault::data);
    return error.what();
  }
  return "";
}

bool holds(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

}  // namespace

TEST_CASE("a million boxes are written and read back, equal to the bit") {
  const Folder folder;
  const Scenes scenes = scenes_of_boxes(1000000, 96);
  const fs::path file = folder.path / "scene.json";
  write_scenes(file, scenes);
  CHECK(boxes_that_differ(scenes, read_scene_file(file)) == 0);
  REQUIRE(box_files(folder.path).size() == 1);
  CHECK(fs::file_size(box_files(folder.path).front()) < 113000000);
  CHECK(fs::file_size(file) < 4000000);
}

TEST_CASE("a scene.json names the boxes that it was written with; others are left behind by no writing") {
  const Folder folder;
  const fs::path file = folder.path / "scene.json", copy = folder.path / "before.json";
  const Scenes first = scenes_of_boxes(200, 2), second = scenes_of_boxes(300, 2);
  write_scenes(file, first);
  const fs::path old_boxes = box_files(folder.path).front();
  const std::string bytes = content_of(old_boxes);
  fs::copy_file(file, copy);
  write_scenes(file, second);
  CHECK(boxes_that_differ(second, read_scene_file(file)) == 0);
  REQUIRE(box_files(folder.path).size() == 1);
  CHECK(box_files(folder.path).front() != old_boxes);
  // A kill between the two files: new boxes lie there, the scene.json of before finds its own.
  write_text(old_boxes, bytes);
  fs::rename(copy, file);
  CHECK(boxes_that_differ(first, read_scene_file(file)) == 0);
  // Photos have none.
  write_scenes(file, scenes_of_boxes(0, 1));
  CHECK(box_files(folder.path).empty());
  CHECK(read_scene_file(file).front().actors.size() == 1);
}

TEST_CASE("a scene.json of schema 2 lists its boxes itself") {
  const Folder folder;
  const Scene scene = read_scene_file(fs::path(CLOAM_SOURCES) / "tests/cli/fixtures/scene.v2.json").front();
  REQUIRE(scene.actors.size() == 3);
  REQUIRE(scene.actors[0].boxes.size() == 3);
  CHECK(scene.actors[0].boxes[1].step == 1);
  CHECK(scene.actors[0].boxes[1].timestamp == 0.2);
  CHECK(scene.actors[0].boxes[1].world_from_box(0, 3) == 5 + 1.0 / 3);
  CHECK(scene.actors[1].boxes.empty());
  CHECK(scene.actors[2].asset == AssetName{0, "a"});
  write_scenes(folder.path / "scene.json", {scene});
  CHECK(boxes_that_differ({scene}, read_scene_file(folder.path / "scene.json")) == 0);
}

TEST_CASE("boxes that are missing, damaged or others are one error that says so") {
  const Folder folder;
  const fs::path file = folder.path / "scene.json";
  write_scenes(file, scenes_of_boxes(200, 2));
  const std::string json = content_of(file);
  const fs::path boxes = box_files(folder.path).front();
  const std::string sound = content_of(boxes);
  const auto told = [&](const std::string& content) {
    write_text(boxes, content);
    const std::string error = error_of_reading(file);
    CHECK(holds(error, boxes.string()));
    CHECK(holds(error, "fix: copy it"));
    return error;
  };
  CHECK(holds(told(sound.substr(0, sound.size() / 2)), "data section"));
  CHECK(holds(told(""), "need 8 bytes"));
  for (const std::size_t at : {std::size_t{20}, sound.size() / 3, sound.size() - 1}) {
    std::string changed = sound;
    changed[at] = static_cast<char>(changed[at] ^ 4);
    CHECK(told(changed) != "");
  }
  fs::remove(boxes);
  CHECK(holds(error_of_reading(file), "boxes of scene.json"));
  write_text(boxes, sound);
  CHECK(error_of_reading(file) == "");
  // What scene.json asks for must be there, and lie beside it.
  const auto edited = [&](const auto& edit) {
    Json scenes = Json::parse(json);
    edit(scenes);
    write_text(file, scenes.dump());
    return error_of_reading(file);
  };
  CHECK(holds(edited([](Json& all) { all["scenes"][1]["actors"][1]["first_box"] = 121; }), "\"first_box\" is 121"));
  CHECK(holds(edited([](Json& all) { all["scenes"][1]["actors"][1]["boxes"] = -1; }), "\"boxes\" is -1"));
  CHECK(holds(edited([](Json& all) { all.erase("box_file"); }), "\"boxes\" is 80"));
  CHECK(holds(edited([](Json& all) { all["box_file"] = "../" + all["box_file"].get<std::string>(); }), "box_file"));
}
