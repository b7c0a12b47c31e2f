// Exports of Polycam and Record3D, written here as those apps do; where the cameras are is told by hand.
#include <doctest/doctest.h>

#include <Eigen/Dense>

#include "models/data/read_scene.h"
#include "models/io/image.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

void write_image(const fs::path& path, int width, int height) {
  fs::create_directories(path.parent_path());
  write_jpeg(path, {width, height, 3, std::vector<std::uint8_t>(std::size_t(width * height * 3), 90)});
}

/// A quarter turn to the left about y, which is up: the camera looks along -x.
const char* const kPolycamCamera = R"({"fx":10,"fy":11,"cx":4.5,"cy":2.5,"width":8,"height":6,"blur_score":90.5,
  "timestamp":7, "t_00":0,"t_01":0,"t_02":1,"t_03":2, "t_10":0,"t_11":1,"t_12":0,"t_13":3, "t_20":-1,"t_21":0,"t_22":0,
  "t_23":4})";

void check_quarter_turn(const Frame& frame) {
  CHECK((frame.world_from_camera * Eigen::Vector4d(0, 0, 1, 0)).isApprox(Eigen::Vector4d(-1, 0, 0, 0), 1e-6));
  CHECK((frame.world_from_camera * Eigen::Vector4d(0, -1, 0, 0)).isApprox(Eigen::Vector4d(0, 1, 0, 0), 1e-6));
  CHECK((frame.world_from_camera * Eigen::Vector4d(1, 0, 0, 0)).isApprox(Eigen::Vector4d(0, 0, -1, 0), 1e-6));
  CHECK(frame.position().isApprox(Eigen::Vector3d(2, 3, 4)));
}

}  // namespace

TEST_CASE("Polycam: cameras by name, in metres with y up; corrected ones first") {
  const Folder folder;
  const fs::path keyframes = folder.path / "keyframes";
  write_text(keyframes / "cameras/71.json", kPolycamCamera);
  write_text(keyframes / "cameras/72.json", kPolycamCamera);
  write_image(keyframes / "images/71.jpg", 8, 6);
  fs::create_directories(keyframes / "depth");
  const Scene scene = read_scene(folder.path);
  CHECK(scene.format == "Polycam");
  CHECK(scene.metric);
  CHECK(scene.up == Eigen::Vector3d(0, 1, 0));
  REQUIRE(scene.frames.size() == 1);
  CHECK(scene.frames_listed == 2);
  CHECK(scene.frames[0].image == "keyframes/images/71.jpg");
  CHECK(scene.cameras == std::vector<Camera>{{8, 6, 10, 11, 4.5, 2.5}});
  check_quarter_turn(scene.frames[0]);
  REQUIRE(scene.warnings.size() == 2);
  CHECK(holds(scene.warnings[0], "keyframes/depth is ignored"));
  CHECK(holds(scene.warnings[1], "1 of 2 listed images are missing and skipped: keyframes/images/72.jpg"));

  write_text(keyframes / "corrected_cameras/71.json", kPolycamCamera);
  write_image(keyframes / "corrected_images/71.jpg", 8, 6);
  CHECK(read_scene(folder.path).frames.at(0).image == "keyframes/corrected_images/71.jpg");
  write_text(keyframes / "corrected_cameras/71.json",
             R"({"fx":10,"fy":11,"cx":4,"cy":3,"width":8,"height":6,"t_00":1})");
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "keyframes/corrected_cameras/71.json"));
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "t_01"));
}

TEST_CASE("Record3D: quaternions with the real part last, K by columns, intrinsics of each photo") {
  const Folder folder;
  const fs::path root = folder.path / "EXR_RGBD";
  const std::string poses = R"("poses":[[0,0.70710678,0,0.70710678,2,3,4],[0,0,0,1,0,0,0],[0,0,0,1,9,0,0]])";
  const std::string all = R"({"w":8,"h":6,"fps":30,"K":[10,0,0,0,11,0,4.2,3.1,1],)" + poses;
  write_text(root / "metadata.json", all + "}");
  for (const char* name : {"0", "1", "2"}) write_image(root / "rgb" / (std::string(name) + ".jpg"), 8, 6);
  Scene scene = read_scene(folder.path);
  CHECK(scene.format == "Record3D");
  CHECK(scene.metric);
  REQUIRE(scene.frames.size() == 3);
  CHECK(scene.cameras == std::vector<Camera>{{8, 6, 10, 11, 4.2, 3.1}});
  check_quarter_turn(scene.frames[0]);
  CHECK(scene.frames[2].position() == Eigen::Vector3d(9, 0, 0));
  CHECK(scene.up.isApprox(Eigen::Vector3d(0, 1, 0), 1e-6));
  CHECK(read_scene(root).frames.size() == 3);  // the folder itself, too

  write_text(root / "metadata.json", all + R"(,"perFrameIntrinsicCoeffs":[[12,13,4,3],[10,11,4.2,3.1],[10,11,1,3]]})");
  scene = read_scene(folder.path);
  CHECK(scene.cameras == std::vector<Camera>{{8, 6, 12, 13, 4, 3}, {8, 6, 10, 11, 4.2, 3.1}, {8, 6, 10, 11, 4, 3}});

  write_text(root / "metadata.json", R"({"w":8,"h":6,"K":[10,0,0,0,11,0,4,3],)" + poses + "}");
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "EXR_RGBD/metadata.json, K: want 9 finite numbers"));
  write_text(root / "metadata.json", R"({"w":8,"h":6,"K":[10,0,0,0,11,0,4,3,1],"poses":[[0,0,0,2,0,0,0]]})");
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "pose 0: the quaternion has the length 2"));
}
