// Readers of captures: the three flavours of transforms.json written here by hand, real captures, and bad input.
#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <cmath>
#include <filesystem>

#include "models/data/load_images.h"
#include "models/data/poses.h"
#include "models/data/read_scene.h"
#include "models/io/image.h"
#include "models/scene/camera.h"
#include "models/scene/split.h"
#include "runtime/error.h"
#include "tests/models/capture.h"
#include "tests/models/errors.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

// The largest distance, in pixels, between a pixel centre and the projection of the direction given for it.
double round_trip_error(const Camera& camera) {
  double worst = 0;
  for (int row = 0; row < camera.height; row += 7) {
    for (int column = 0; column < camera.width; column += 7) {
      const Eigen::Vector2d point(column + 0.5, row + 0.5);
      worst = std::max(worst, (project(camera, 3 * direction(camera, point)) - point).norm());
    }
  }
  return worst;
}

}  // namespace

TEST_CASE("NeRF-synthetic: size from the image, splits from the files, axes turned to OpenCV") {
  const Capture folder;
  folder.image("train/r_0.png", 8, 6, {10, 20, 30, 128});
  folder.image("test/r_0.png", 8, 6, {10, 20, 30, 255});
  const std::string angle = R"("camera_angle_x":1.0)";
  folder.text_file("transforms_train.json", capture(frame("./train/r_0"), angle));
  folder.text_file("transforms_test.json", capture(frame("./test/r_0"), angle));
  const Scene scene = read_scene(folder.path);
  REQUIRE(scene.frames.size() == 2);
  CHECK(frames_of(scene, Split::train).size() == 1);
  CHECK(frames_of(scene, Split::test).size() == 1);
  CHECK(scene.has_alpha);
  CHECK(scene.has_test_split);
  CHECK(scene.hints.synthetic_bounds);
  REQUIRE(scene.cameras.size() == 1);
  CHECK(scene.cameras[0].fx == doctest::Approx(4 / std::tan(0.5)));
  CHECK(scene.cameras[0].cx == 4);
  CHECK(scene.cameras[0].cy == 3);
  const Eigen::Matrix4d& pose = scene.frames[0].world_from_camera;
  // OpenGL looks along -z, which kPose turns to +y of the world; its up, +y, is the world's +z.
  CHECK((pose * Eigen::Vector4d(0, 0, 1, 0)).isApprox(Eigen::Vector4d(0, 1, 0, 0)));
  CHECK((pose * Eigen::Vector4d(0, 1, 0, 0)).isApprox(Eigen::Vector4d(0, 0, -1, 0)));
  CHECK(pose.col(3).isApprox(Eigen::Vector4d(2, 3, 4, 1)));
  const Pixels pixels = load_images(scene, Split::train);
  CHECK(pixels.has_alpha);
  CHECK(std::vector<int>(pixels.frames.at(0).rgba.begin(), pixels.frames[0].rgba.begin() + 4) ==
        std::vector<int>{10, 20, 30, 128});
}

TEST_CASE("instant-ngp: intrinsics of the file, missing images in one warning") {
  const Capture folder;
  folder.image("images/b.png", 8, 6, {1, 2, 3});
  folder.image("images/a.png", 8, 6, {1, 2, 3});
  folder.text_file(
      "transforms.json",
      capture(frame("images/b.png") + "," + frame("images/x.png") + "," + frame("images/a.png"),
              R"("fl_x":10,"fl_y":11,"cx":3.5,"cy":2.5,"w":8.0,"h":6.0,"k1":0.1,"p2":0.01,"aabb_scale":16)"));
  Scene scene = read_scene(folder.path);
  CHECK(scene.frames_listed == 3);
  CHECK(scene.frames.size() == 2);
  CHECK(scene.warnings == std::vector<std::string>{"1 of 3 listed images are missing and skipped: images/x.png"});
  const Camera wanted{8, 6, 10, 11, 3.5, 2.5, CameraModel::opencv, {0.1, 0, 0, 0}, 0, 0.01};
  CHECK(scene.cameras == std::vector<Camera>{wanted});
  CHECK(scene.hints.aabb_scale == 16.0);
  CHECK_FALSE(scene.has_alpha);
  CHECK_FALSE(scene.has_test_split);
  CHECK(frames_of(scene, Split::test).empty());
  apply_holdout(scene, 2);
  REQUIRE(frames_of(scene, Split::test).size() == 1);
  CHECK(scene.frames[frames_of(scene, Split::test)[0]].image == "images/a.png");  // first by name, not as listed
  CHECK(holds(error_of([&] { apply_holdout(scene, 1); }, Fault::usage), "--holdout 1"));
}

TEST_CASE("nerfstudio: intrinsics of a frame, fisheye, masks, list of test images") {
  const Capture folder;
  folder.image("a.png", 8, 6, {1, 2, 3});
  folder.image("b.png", 4, 4, {1, 2, 3});
  folder.image("mask.png", 8, 6, {0});
  const std::string own = R"(,"w":4,"h":4,"fl_x":5,"k1":0.2,"cx":1,"cy":2)";
  folder.text_file(
      "transforms.json",
      capture(frame("a.png", kPose, R"(,"mask_path":"mask.png","time":0.5)") + "," + frame("b.png", kPose, own),
              R"("fl_x":10,"w":8,"h":6,"camera_model":"OPENCV_FISHEYE","test_filenames":["b.png"])"));
  const Scene scene = read_scene(folder.path);
  REQUIRE(scene.cameras.size() == 2);
  CHECK(scene.cameras[0].model == CameraModel::fisheye);
  CHECK(scene.cameras[1] == Camera{4, 4, 5, 5, 1, 2, CameraModel::fisheye, {0.2, 0, 0, 0}, 0, 0});
  CHECK(scene.frames[0].timestamp == 0.5);
  CHECK(scene.frames[0].split == Split::train);
  CHECK(scene.frames[1].split == Split::test);
  const Pixels pixels = load_images(scene, Split::train, {2});
  CHECK(pixels.frames.at(0).mask == std::vector<std::uint8_t>(4 * 3, 0));
  CHECK(pixels.cameras.at(0).fx == 5);
  CHECK(load_images(scene, Split::test).frames.at(0).mask.empty());
}

TEST_CASE("a mask's pixel counts only if all that it stands for do") {
  const Capture folder;
  folder.image("a.png", 4, 2, {1, 2, 3});
  Image mask{4, 2, 1, {255, 255, 255, 255, 255, 0, 255, 255}};
  write_png(folder.path / "mask.png", mask);
  folder.text_file("transforms.json",
                   capture(frame("a.png", kPose, R"(,"mask_path":"mask.png")"), R"("fl_x":4,"w":4,"h":2)"));
  CHECK(load_images(read_scene(folder.path), Split::train, {2}).frames.at(0).mask == std::vector<std::uint8_t>{0, 255});
}

TEST_CASE("fox: 50 of 67 images, intrinsics by hand at factor 6, directions match the distortion") {
  if (no_data(test_data("fox"))) return;
  Scene scene = read_scene(test_data("fox"));
  CHECK(scene.frames_listed == 67);
  CHECK(scene.frames.size() == 50);
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "17 of 67 listed images are missing and skipped: images/"));
  REQUIRE(scene.cameras.size() == 1);
  apply_holdout(scene, 8);
  CHECK(frames_of(scene, Split::test).size() == 7);
  CHECK(scene.frames[frames_of(scene, Split::test)[0]].image == "images/0001.jpg");
  const Camera small = scaled(scene.cameras[0], 6);
  CHECK(small.width == 180);
  CHECK(small.height == 320);
  CHECK(small.fx == doctest::Approx(229.253333));
  CHECK(small.cy == doctest::Approx(160.878));
  CHECK(round_trip_error(scene.cameras[0]) < 1e-6);
  // Pixel (0, 0): distort the direction again, written out from the formula of OpenCV.
  const auto directions = pixel_directions(small);
  REQUIRE(directions.size() == 3u * 180 * 320);
  const double x = directions[0], y = directions[1], r2 = x * x + y * y;
  const double gain = 1 + 0.0578421 * r2 - 0.0805099 * r2 * r2, p1 = -0.000980296, p2 = 0.00015575;
  CHECK(directions[2] == 1);
  CHECK(small.fx * (x * gain + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + small.cx ==
        doctest::Approx(0.5).epsilon(1e-4));
  CHECK(small.fy * (y * gain + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + small.cy ==
        doctest::Approx(0.5).epsilon(1e-4));
  const Pixels test = load_images(scene, Split::test, {6});
  CHECK(test.frames.size() == 7);
  CHECK(test.frames[0].rgba.size() == 4u * 180 * 320);
  CHECK_FALSE(test.has_alpha);
  CHECK(check_scene(scene).empty());
}

TEST_CASE("lego: 100 and 25 views with alpha, focal length of the paper") {
  if (no_data(test_data("lego_400"))) return;
  const Scene scene = read_scene(test_data("lego_400"));
  CHECK(frames_of(scene, Split::train).size() == 100);
  CHECK(frames_of(scene, Split::test).size() == 25);
  CHECK(scene.has_alpha);
  REQUIRE(scene.cameras.size() == 1);
  CHECK(scene.cameras[0].fx == doctest::Approx(1111.111 / 2));
  for (const Frame& view : scene.frames) {
    const Eigen::Vector3d position = view.world_from_camera.topRightCorner<3, 1>();
    CHECK(position.norm() == doctest::Approx(4.0311).epsilon(1e-3));
    // All cameras look at the middle: the centre of the scene lies on the optical axis, in front.
    const Eigen::Vector3d middle = view.world_from_camera.topLeftCorner<3, 3>().transpose() * -position;
    CHECK(middle.z() == doctest::Approx(position.norm()).epsilon(1e-3));
  }
}

TEST_CASE("directions undo each lens, also strong ones") {
  Camera camera{64, 48, 60, 55, 31, 25, CameraModel::opencv, {-0.2, 0.05, -0.01, 0.002}, 0.003, -0.002};
  CHECK(round_trip_error(camera) < 1e-6);
  camera = {64, 48, 25, 24, 31, 25, CameraModel::fisheye, {0.05, -0.01, 0.002, -0.0003}, 0, 0};
  CHECK(round_trip_error(camera) < 1e-6);
  for (float value : pixel_directions(camera)) CHECK(std::isfinite(value));
  CHECK(direction(camera, {0, 0}).norm() == doctest::Approx(1));
  camera.k = {0, 0, 0, 0};  // equidistant: the angle is the radius over the focal length
  camera.fy = 25;
  CHECK(direction(camera, {31 + 25 * 1.2, 25}).isApprox(Eigen::Vector3d(std::sin(1.2), 0, std::cos(1.2)), 1e-12));
  camera = {64, 48, 6, 5, 31, 25, CameraModel::opencv, {-5, 3, -100, 50}, 1, 1};  // has no inverse
  for (float value : pixel_directions(camera)) CHECK(std::isfinite(value));
}

TEST_CASE("a downscaled camera sees the centre of a box where the box is") {
  const Camera camera{64, 48, 60, 55, 31, 25, CameraModel::opencv, {-0.1, 0, 0, 0}, 0, 0};
  const Camera half = scaled(camera, 4);
  CHECK(direction(half, {2.5, 3.5}).isApprox(direction(camera, {10, 14}), 1e-12));
  CHECK(scaled(camera, 5).width == 12);
  CHECK(holds(error_of([&] { scaled(camera, 49); }, Fault::usage), "--downscale 49"));
}

TEST_CASE("points that a list names and that are missing are told") {
  const Capture folder;
  folder.image("a.png", 8, 6, {1, 2, 3});
  folder.text_file("transforms.json", capture(frame("a.png"), R"("fl_x":10,"w":8,"h":6,"ply_file_path":"points.ply")"));
  const Scene scene = read_scene(folder.path);
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "ply_file_path names points.ply, which is missing"));
}

TEST_CASE("nerfstudio: the points that a list names are the scene's, in the coordinates of the poses") {
  const Capture folder;
  folder.image("a.png", 8, 6, {1, 2, 3});
  folder.text_file("transforms.json", capture(frame("a.png"), R"("fl_x":10,"w":8,"h":6,"ply_file_path":"points.ply")"));
  folder.text_file("points.ply",
                   "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                   "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
                   "1 2 3 255 0 10\nnan 0 0 1 1 1\n-4 5 6.5 7 8 9\n");
  const Scene scene = read_scene(folder.path);
  CHECK(scene.cloud.positions == std::vector<float>{1, 2, 3, -4, 5, 6.5});
  CHECK(scene.cloud.colours == std::vector<std::uint8_t>{255, 0, 10, 7, 8, 9});
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "1 of 3 points of points.ply are left out"));
  folder.text_file("points.ply", "no ply");
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "points.ply"));
  CHECK(holds(read_scene(folder.path, {true, false}).warnings.at(0), "points dropped"));
}

TEST_CASE("images of another size scale the intrinsics, of another shape are refused") {
  const Capture folder;
  folder.image("a.png", 16, 12, {1, 2, 3});
  folder.text_file("transforms.json", capture(frame("a.png")));
  const Pixels pixels = load_images(read_scene(folder.path), Split::train);
  CHECK(pixels.cameras.at(0) == Camera{16, 12, 20, 20, 8, 6, CameraModel::pinhole, {}, 0, 0});
  REQUIRE(pixels.warnings.size() == 1);
  CHECK(holds(pixels.warnings[0], "16x12 pixels, listed as 8x6"));
  folder.image("a.png", 12, 16, {1, 2, 3});
  const Scene turned = read_scene(folder.path);
  CHECK(holds(error_of([&] { load_images(turned, Split::train); }), "aspect ratio"));
}

TEST_CASE("cameras are those of the photos, whatever size the list has") {
  const Capture folder;
  folder.image("a.png", 16, 12, {1, 2, 3});
  folder.image("b.png", 8, 6, {1, 2, 3});
  folder.image("c.png", 16, 12, {1, 2, 3});
  folder.image("d.png", 9, 6, {1, 2, 3});  // of another shape: told by who loads it
  folder.text_file("transforms.json",
                   capture(frame("a.png") + "," + frame("b.png") + "," + frame("c.png") + "," + frame("d.png")));
  Scene scene = read_scene(folder.path);
  fit_cameras(scene);
  const Camera listed{8, 6, 10, 10, 4, 3};
  CHECK(scene.cameras == std::vector<Camera>{{16, 12, 20, 20, 8, 6}, listed});
  CHECK(scene.frames[0].camera == 0);
  CHECK(scene.frames[1].camera == 1);
  CHECK(scene.frames[2].camera == 0);
  CHECK(scene.frames[3].camera == 1);
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "2 images (a.png: 16x12 pixels, listed as 8x6, ...) do not have the size"));
  scene.frames.pop_back();
  CHECK(load_images(scene, Split::train).warnings.empty());
}

TEST_CASE("poses: a uniform scale is taken out, rounding is mended") {
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  pose.topLeftCorner<3, 3>() = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).matrix();
  Eigen::Matrix4d given = pose;
  given.topLeftCorner<3, 3>() *= 0.33;
  CHECK(rigid(given, "x").isApprox(pose, 1e-12));
  given = pose;
  given(0, 1) += 1e-3;
  const Eigen::Matrix3d mended = rigid(given, "x").topLeftCorner<3, 3>();
  CHECK((mended * mended.transpose()).isApprox(Eigen::Matrix3d::Identity(), 1e-12));
}

TEST_CASE("check_scene warns of places that float32 rounds to more than a ten thousandth of the capture") {
  Scene scene;
  scene.frames.resize(3);
  const auto warnings = [&](double far) {
    for (int i = 0; i < 3; ++i) {
      scene.frames[std::size_t(i)].image = std::to_string(i);
      scene.frames[std::size_t(i)].world_from_camera.topRightCorner<3, 1>() = Eigen::Vector3d(far, 3. * i, 0);
    }
    return check_scene(scene);
  };
  CHECK(warnings(1e4).empty());
  REQUIRE(warnings(1e6).size() == 1);
  CHECK(holds(warnings(1e6)[0], "the cameras are 1e+06 units from the origin"));
  CHECK(holds(warnings(1e6)[0], "subtract 1000000, 3, 0 from all positions"));
  scene.is_log = true;
  CHECK(warnings(1e6).empty());
}

TEST_CASE("check_scene names what occurs twice and cameras that stand in one place") {
  Scene scene;
  scene.frames.resize(2);
  scene.frames[0].image = "a.png";
  scene.frames[1].image = "a.png";
  const auto warnings = check_scene(scene);
  REQUIRE(warnings.size() == 3);
  CHECK(holds(warnings[0], "a.png is listed twice"));
  CHECK(holds(warnings[1], "same pose"));
  CHECK(holds(warnings[2], "one place"));
}
