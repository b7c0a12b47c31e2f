// A scene at rest is the scene to the bit, in less memory, whatever of it a store holds.
#include "models/scene/resting_scene.h"

#include <doctest/doctest.h>

#include "tests/models/errors.h"
#include "tests/models/folder.h"
#include "tests/models/toy_street.h"

namespace cloam {
namespace {

/// Something in every field.
Scene full_scene() {
  Scene scene = toy_street("a/folder", {.frames = 3});
  scene.up = {0.1, -0.2, 1 / 3.0};
  scene.has_alpha = scene.has_test_split = scene.night = true;
  scene.hints = {4.5, true, 0.25};
  scene.cameras[0].model = CameraModel::fisheye;
  scene.cameras[0].k = {0.1, 0.2, 0.3, 0.4};
  scene.cameras[0].prism = {1e-3, 2e-3};
  scene.frames[1].mask = "mask.png";
  scene.frames[1].timestamp.reset();
  scene.frames[2].split = Split::test;
  scene.frames[2].ego_rows = 0.125;
  scene.frames_listed = 7;
  scene.sweeps.push_back({"lidar/00.pkl", 0.1, toy_pose(1 / 7.0, 2, 3), 4, Split::unused, false,
                          Eigen::Vector3d(1, 2, 3), Eigen::Vector3d(4, 5, 6)});
  scene.actors = {toy_actor("first", {2, 4, 1.5}, 12, -1 / 3.0), toy_actor("", {1, 1, 2}, 5, 4)};
  scene.actors[0].stationary = true;
  scene.actors[1].asset = AssetName{3, "other"};
  scene.other_actors = 9;
  scene.cloud = {{1.5f, 2.5f, 3.5f}, {10, 20, 30}};
  scene.recording.sweep_seconds = 0.1;
  scene.recording.front_from_lidar = toy_pose(0, 1 / 9.0, 0);
  scene.recording.car = CarBox{{1, 2, 3}, {4, 5, 6}};
  scene.recording.car_rows = {{"back_camera", 0.1}, {"front_camera", 0}};
  scene.recording.poses_replaced = 2;
  scene.warnings = {"one", ""};
  return scene;
}

void check_same_frames(const Scene& a, const Scene& b) {
  REQUIRE(a.frames.size() == b.frames.size());
  for (std::size_t i = 0; i < a.frames.size(); ++i) {
    const Frame &one = a.frames[i], &other = b.frames[i];
    CHECK(one.name == other.name);
    CHECK(one.image == other.image);
    CHECK(one.mask == other.mask);
    CHECK(one.timestamp == other.timestamp);
    CHECK(one.world_from_camera == other.world_from_camera);
    CHECK(one.camera == other.camera);
    CHECK(one.split == other.split);
    CHECK(one.sensor == other.sensor);
    CHECK(one.step == other.step);
    CHECK(one.ego_rows == other.ego_rows);
  }
}

void check_same_sweeps(const Scene& a, const Scene& b) {
  REQUIRE(a.sweeps.size() == b.sweeps.size());
  for (std::size_t i = 0; i < a.sweeps.size(); ++i) {
    const Sweep &one = a.sweeps[i], &other = b.sweeps[i];
    CHECK(one.file == other.file);
    CHECK(one.timestamp == other.timestamp);
    CHECK(one.world_from_lidar == other.world_from_lidar);
    CHECK(one.step == other.step);
    CHECK(one.split == other.split);
    CHECK(one.points_in_world == other.points_in_world);
    CHECK(one.velocity == other.velocity);
    CHECK(one.second_lidar == other.second_lidar);
  }
}

void check_same_actors(const Scene& a, const Scene& b) {
  REQUIRE(a.actors.size() == b.actors.size());
  for (std::size_t i = 0; i < a.actors.size(); ++i) {
    const Actor &one = a.actors[i], &other = b.actors[i];
    CHECK(one.id == other.id);
    CHECK(one.label == other.label);
    CHECK(one.size == other.size);
    CHECK(one.stationary == other.stationary);
    CHECK(one.asset == other.asset);
    REQUIRE(one.boxes.size() == other.boxes.size());
    for (std::size_t k = 0; k < one.boxes.size(); ++k) {
      CHECK(one.boxes[k].step == other.boxes[k].step);
      CHECK(one.boxes[k].timestamp == other.boxes[k].timestamp);
      CHECK(one.boxes[k].world_from_box == other.boxes[k].world_from_box);
    }
  }
}

void check_same(const Scene& a, const Scene& b) {
  CHECK(a.root == b.root);
  CHECK(a.format == b.format);
  CHECK(a.up == b.up);
  CHECK(std::tie(a.metric, a.has_alpha, a.has_test_split, a.is_log, a.night) ==
        std::tie(b.metric, b.has_alpha, b.has_test_split, b.is_log, b.night));
  CHECK(a.hints.aabb_scale == b.hints.aabb_scale);
  CHECK(a.hints.synthetic_bounds == b.hints.synthetic_bounds);
  CHECK(a.hints.nearest == b.hints.nearest);
  CHECK(a.cameras == b.cameras);
  CHECK(std::tie(a.frames_listed, a.other_actors) == std::tie(b.frames_listed, b.other_actors));
  CHECK(a.cloud.positions == b.cloud.positions);
  CHECK(a.cloud.colours == b.cloud.colours);
  CHECK(a.recording == b.recording);
  CHECK(a.warnings == b.warnings);
  check_same_frames(a, b);
  check_same_sweeps(a, b);
  check_same_actors(a, b);
}

}  // namespace

TEST_CASE("a packed scene is unpacked to the bit, every field of it") {
  const Scene scene = full_scene();
  check_same(unpacked_scene(packed(scene)), scene);
  check_same(unpacked_scene(packed(Scene{})), Scene{});
}

TEST_CASE("a scene at rest is the same whether a store has room for it or not, and in memory") {
  const Scene scene = full_scene();
  const auto none = std::make_shared<HostStore>(0, 0), roomy = std::make_shared<HostStore>(1 << 20, 0);
  check_same(*RestingScene(scene).get(), scene);
  for (const auto& store : {none, roomy}) {
    const RestingScene resting(scene, store), copy = resting;
    check_same(*resting.get(), scene);
    check_same(*copy.get(), scene);
  }
  CHECK(none->use().made == 2);
  CHECK(roomy->use().made == 1);
}

TEST_CASE("a log of many boxes takes a quarter of its memory at rest") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 80});
  for (int i = 0; i < 40; ++i) {
    scene.actors.push_back(toy_actor(std::to_string(i), {2, 4, 1.5}, i / 3.0, i));
    for (ActorBox& box : scene.actors.back().boxes) box.world_from_box(0, 3) += box.timestamp / 7;
  }
  std::size_t bytes = sizeof(Frame) * scene.frames.size();
  for (const Actor& actor : scene.actors) bytes += sizeof(ActorBox) * actor.boxes.size();
  CHECK(packed(scene).size() < bytes / 4);
}

TEST_CASE("bytes that are no packed scene are told") {
  std::vector<uint8_t> bytes = packed(full_scene());
  bytes.resize(bytes.size() / 2);
  CHECK(holds(error_of([&] { unpacked_scene(bytes); }), "a packed scene: "));
  bytes = packed(full_scene());
  bytes[bytes.size() / 2] ^= 1;
  CHECK(holds(error_of([&] { unpacked_scene(bytes); }), "a packed scene: "));
}

}  // namespace cloam
