// Readers of captures: the three flavours of transforms.json written here by hand, real captures, and bad input.
#include <doctest/doctest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "models/data/load_images.h"
#include "models/data/near_misses.h"
#include "models/data/poses.h"
#include "models/data/read_scene.h"
#include "models/data/write_transforms.h"
#include "models/io/image.h"
#include "models/io/json.h"
#include "models/scene/camera.h"
#include "models/scene/split.h"
#include "runtime/error.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

const std::string kPose = "[[1,0,0,2],[0,0,-1,3],[0,1,0,4],[0,0,0,1]]";

// A capture in a temporary folder.
class Capture : public Folder {
 public:
  void text_file(const std::string& name, const std::string& content) const { std::ofstream(path / name) << content; }

  void image(const std::string& name, int width, int height, std::vector<std::uint8_t> colour) const {
    Image image{width, height, static_cast<int>(colour.size()), {}};
    for (int i = 0; i < width * height; ++i) image.pixels.insert(image.pixels.end(), colour.begin(), colour.end());
    fs::create_directories((path / name).parent_path());
    write_png(path / name, image);
  }
};

std::string frame(const std::string& image, const std::string& pose = kPose, const std::string& more = "") {
  return R"({"file_path":")" + image + R"(","transform_matrix":)" + pose + more + "}";
}

// An 8x6 capture whose one frame is given as JSON.
std::string capture(const std::string& frames, const std::string& more = R"("fl_x":10,"w":8,"h":6)") {
  return "{" + more + R"(,"frames":[)" + frames + "]}";
}

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

TEST_CASE("folders that are almost a capture say what is wrong") {
  const Capture folder;
  const auto advice = [&](const std::string& name) { return error_of([&] { read_scene(folder.path / name); }); };
  const auto with = [&](const std::string& file) {
    fs::remove_all(folder.path / "data");
    fs::create_directories((folder.path / "data" / file).parent_path());
    folder.text_file("data/" + file, "");
    return advice("data");
  };
  CHECK(holds(with("sparse/0/cameras.bin"), "needs sparse/0/images.bin beside sparse/0/cameras.bin"));
  CHECK(holds(with("images.txt"), "needs cameras.txt beside images.txt"));
  CHECK(holds(with("Transforms.JSON"), "rename Transforms.JSON to transforms.json"));
  CHECK(holds(with("transforms.json.gz"), "unpack transforms.json.gz"));
  CHECK(holds(with("transforms_test.json"), "add transforms_train.json"));
  CHECK(holds(with("IMG_1.HEIC"), "cloam process " + (folder.path / "data").string() + " -o DATA"));
  CHECK(holds(with("images/IMG_1.heic"), "cloam process " + (folder.path / "data/images").string() + " -o DATA"));
  CHECK(holds(with("walk.MP4"), "cloam process " + (folder.path / "data/walk.MP4").string() + " -o DATA"));
  CHECK(holds(with("images/1.jpg"), "cloam process " + (folder.path / "data/images").string() + " -o DATA"));
  folder.image("my walk/1.png", 8, 6, {1, 2, 3});
  CHECK(holds(advice("my walk"), "cloam process '" + (folder.path / "my walk").string() + "' -o DATA"));
  folder.text_file("my walk/run.json", "");
  CHECK(holds(advice("my walk"), "cloam train --resume '" + (folder.path / "my walk").string() + "'"));
  for (const char* file : {"data.zip", "data.tar.gz"}) {
    folder.text_file(file, "");
    CHECK(holds(advice(file), "is an archive; unpack it"));
  }
  folder.text_file("walk.mov", "");
  CHECK(holds(advice("walk.mov"), "cloam process "));
  CHECK(holds(advice("gone"), "no such folder: " + (folder.path / "gone").string()));
  CHECK_FALSE(holds(advice("gone"), "looked for"));
}

TEST_CASE("a folder and files that may not be read: permission denied") {
  if (geteuid() != 0) {
    MESSAGE("skipped: only root can become somebody else");
    return;
  }
  const Capture folder;
  fs::permissions(folder.path, fs::perms::all);
  folder.image("open/a.png", 8, 6, {1, 2, 3});
  folder.text_file("open/transforms.json", capture(frame("a.png")));
  fs::copy(folder.path / "open", folder.path / "closed", fs::copy_options::recursive);
  fs::permissions(folder.path / "closed", fs::perms::owner_all);
  const auto as_nobody = [&](const char* name) {
    REQUIRE(seteuid(65534) == 0);
    const std::string message = error_of([&] { load_images(read_scene(folder.path / name), Split::train); });
    REQUIRE(seteuid(0) == 0);
    return message;
  };
  CHECK(holds(as_nobody("closed"), (folder.path / "closed").string() + ": permission denied"));
  fs::permissions(folder.path / "closed", fs::perms::owner_all | fs::perms::group_read | fs::perms::others_read);
  CHECK(holds(as_nobody("closed"), (folder.path / "closed").string() + ": permission denied"));
  fs::permissions(folder.path / "open/a.png", fs::perms::owner_all);
  CHECK(holds(as_nobody("open"), "a.png: permission denied"));
  fs::permissions(folder.path / "open/transforms.json", fs::perms::owner_all);
  CHECK(holds(as_nobody("open"), "transforms.json: permission denied"));
}

TEST_CASE("folders that are no data set say what was looked for, found, and what to do") {
  const Capture folder;
  const std::string empty = error_of([&] { read_scene(folder.path); });
  CHECK(holds(empty, "looked for: transforms.json"));
  CHECK(holds(empty, "the folder is empty"));
  folder.image("walk/images/a.png", 2, 2, {1, 2, 3});
  CHECK(holds(error_of([&] { read_scene(folder.path / "walk"); }), "images/"));
  CHECK(holds(error_of([&] { read_scene(folder.path / "walk/images"); }), "1 .png"));
  CHECK(holds(error_of([&] { read_scene(folder.path / "wolk"); }), "did you mean " + (folder.path / "walk").string()));
  CHECK(holds(error_of([&] { read_scene(folder.path / "wolk/"); }), "did you mean"));
  folder.text_file("walk/transforms.json", capture(frame("images/a.png"), R"("fl_x":2)"));
  CHECK(holds(error_of([&] { read_scene(folder.path / "walk/transforms.json"); }), "give its folder"));
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "give the folder inside it"));
  fs::create_directory_symlink(folder.path / "walk", folder.path / "link");
  CHECK(read_scene(folder.path / "link").frames.size() == 1);
}

TEST_CASE("bad frames stop with the frame and key named, or are dropped with skip_bad") {
  const Capture folder;
  folder.image("a.png", 8, 6, {1, 2, 3});
  folder.image("b.png", 8, 6, {1, 2, 3});
  const auto attempt = [&](const std::string& bad) {
    folder.text_file("transforms.json", capture(frame("b.png") + "," + bad));
    const std::string message = error_of([&] { read_scene(folder.path); });
    const Scene rest = read_scene(folder.path, {true});
    CHECK(rest.frames.size() == 1);
    CHECK(rest.warnings.size() == 1);
    return message;
  };
  const auto pose = [](const std::string& first) { return "[[" + first + ",0,0,2],[0,0,-1,3],[0,1,0,4],[0,0,0,1]]"; };
  for (const char* value : {"NaN", "-Infinity", "null", "\"1\"", "[]"}) {
    const std::string message = attempt(frame("a.png", pose(value)));
    CHECK_MESSAGE(holds(message, "frame 1 (a.png): transform_matrix[0][0]"), message);
  }
  CHECK(holds(attempt(frame("a.png", pose("-1"))), "mirrored"));
  CHECK(holds(attempt(frame("a.png", pose("0"))), "determinant 0"));
  CHECK(holds(attempt(frame("a.png", pose("1.2"))), "not hold a rotation"));
  CHECK(holds(attempt(frame("a.png", "[[1,0,0,1e300],[0,0,-1,3],[0,1,0,4],[0,0,0,1]]")), "position"));
  CHECK(holds(attempt(frame("a.png", "[[1,0,0],[0,1,0],[0,0,1]]")), "transform_matrix[0]"));
  CHECK(holds(attempt(frame("a.png", "[[1,0,0,0]]")), "has 1 rows"));
  CHECK(holds(attempt(R"({"file_path":"a.png"})"), "transform_matrix is missing"));
  CHECK(holds(attempt(R"({"transform_matrix":)" + kPose + "}"), "file_path is missing"));
  CHECK(holds(attempt(R"({"file_path":7,"transform_matrix":)" + kPose + "}"), "want a string"));
  CHECK(holds(attempt("[]"), "frame 1"));
  CHECK(holds(attempt(frame("a.png", kPose, R"(,"fl_x":0)")), "fx 0"));
  CHECK(holds(attempt(frame("a.png", kPose, R"(,"w":7.5)")), "w is 7.5"));
  CHECK(holds(attempt(frame("a.png", kPose, R"(,"camera_model":"EQUIRECTANGULAR")")), "EQUIRECTANGULAR"));
  CHECK(holds(attempt(frame("a.png", kPose, R"(,"mask_path":"no.png")")), "no.png"));
  CHECK(holds(attempt(frame("a.png", kPose, R"(,"mask_path":"../b.png")")), "leaves the data folder"));
}

TEST_CASE("bad files stop with the place named") {
  const Capture folder;
  folder.image("a.png", 8, 6, {1, 2, 3});
  const auto attempt = [&](const std::string& content) {
    folder.text_file("transforms.json", content);
    return error_of([&] { read_scene(folder.path); });
  };
  CHECK(holds(attempt("{\n \"w\": 8,\n oops }"), "line 3"));
  CHECK(holds(attempt("{\n \"frames\": [],\n \"w\": 1e999}"), "line 3, column 7"));
  CHECK(holds(attempt(R"({"w":8,"w":9,"frames":[]})"), "\"w\" appears twice"));
  CHECK(holds(attempt(std::string(100000, '[')), "nested deeper"));
  CHECK(holds(attempt(R"({"frames":[],"w":)" + std::string(64, '[')), "nested deeper than 64"));
  CHECK(holds(attempt(R"({"frames":[],"w":)" + std::string(63, '[')), "unexpected end of input"));
  CHECK(attempt(R"({"w":")" + std::string(100000, 'a')).size() < 1000);
  CHECK(holds(attempt("{}"), "frames is missing"));
  CHECK(holds(attempt(capture("")), "no usable image: 0 listed"));
  CHECK(holds(attempt(capture(frame("gone.png"))), "1 missing (first: gone.png)"));
  CHECK(holds(attempt(capture(frame("a.png"), R"("w":8)")), "looked for fl_x"));
  CHECK(holds(attempt(capture(frame("a.png"), R"("camera_angle_x":3.2)")), "camera_angle_x"));
  CHECK(holds(attempt("\xff\xfe{"), "line 1"));
  CHECK(holds(attempt(""), "line 1"));
}

TEST_CASE(
    "a path that leaves the folder needs the user's leave, and the error is the same whether or not it is there") {
  const Capture outside;
  const Capture folder;
  outside.image("real.png", 8, 6, {1, 2, 3});
  folder.image("a.png", 8, 6, {4, 5, 6});
  const std::string up = "../" + outside.path.filename().string();
  const auto read = [&](const std::string& path, const ReadOptions& options = {}) {
    folder.text_file("transforms.json", capture(frame(path)));
    return read_scene(folder.path, options);
  };
  const auto refusal = [&](const std::string& path) {
    const std::string message = error_of([&] { read(path); });
    CHECK_MESSAGE(holds(message, "leaves the data folder"), message);
    CHECK_MESSAGE(holds(message, "--allow-outside"), message);
    return message.substr(0, message.find(path)) + message.substr(message.find(path) + path.size());
  };
  for (const std::string& folder_out : {up, outside.path.string()})
    CHECK(refusal(folder_out + "/real.png") == refusal(folder_out + "/gone.png"));
  for (const char* path : {"images/../../x", "..", "/dev/zero", "/etc/hostname", "/"}) refusal(path);
  folder.text_file("transforms.json", capture(frame("a.png", kPose, R"(,"mask_path":")" + up + R"(/real.png")")));
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "--allow-outside"));

  const ReadOptions allowed{false, true};
  for (const std::string& path : {up + "/real.png", (outside.path / "real.png").string()}) {
    const Scene scene = read(path, allowed);
    CHECK(scene.frames.at(0).image == path);
    CHECK(load_images(scene, Split::train).frames.at(0).rgba[0] == 1);
  }
  CHECK(holds(error_of([&] { read("/dev/zero", allowed); }), "is not a regular file"));
  CHECK(holds(error_of([&] { load_images(read("/etc/hostname", allowed), Split::train); }), "want a PNG"));
  CHECK(holds(error_of([&] { read("", allowed); }), "transforms.json, frame 0: file_path is empty"));
  CHECK(holds(error_of([&] { read("a\\u0000b", allowed); }), "control character"));
  CHECK(holds(error_of([&] { read(std::string(5000, 'a'), allowed); }), "5000 characters"));
}

TEST_CASE("absolute paths and .. that stay in the folder need nothing") {
  const Capture folder;
  folder.image("images/a.png", 8, 6, {1, 2, 3});
  const std::string other_name = folder.path.string() + "-link";
  fs::create_directory_symlink(folder.path, other_name);
  for (const fs::path& path :
       {folder.path / "images/a.png", fs::path(other_name) / "images/a.png", fs::path("images/../images/a.png"),
        fs::path("./images//a.png"), fs::path("..") / folder.path.filename() / "images/a.png"}) {
    folder.text_file("transforms.json", capture(frame(path.string())));
    CHECK(read_scene(folder.path).frames.at(0).image == "images/a.png");
    CHECK(read_scene(other_name).frames.at(0).image == "images/a.png");
  }
  fs::remove(other_name);
}

TEST_CASE("a list from another machine: the file that the folder has is named before any leave is asked for") {
  const Capture folder;
  folder.image("images/a.png", 8, 6, {1, 2, 3});
  for (const char* path : {"/home/joe/walk/images/a.png", "../walk/images/a.png", "/a/../b/images/a.png"}) {
    folder.text_file("transforms.json", capture(frame(path)));
    const std::string message = error_of([&] { read_scene(folder.path); });
    CHECK_MESSAGE(holds(message, folder.path.string() + ", which has images/a.png: "), message);
    CHECK_MESSAGE(holds(message, "fix: write images/a.png there"), message);
  }
}

TEST_CASE("nerfstudio: names in lists may begin with ./; others are told; what no list names is not used") {
  const Capture folder;
  for (const char* name : {"images/a.png", "images/b.png", "images/c.png", "images/d.png"})
    folder.image(name, 8, 6, {1, 2, 3});
  const auto read = [&](const std::string& lists) {
    folder.text_file("transforms.json",
                     capture(frame("images/a.png") + "," + frame("./images/b.png") + "," + frame("images/c.png") + "," +
                                 frame("images/d.png") + "," + frame("images/gone.png"),
                             R"("fl_x":10,"w":8,"h":6,)" + lists));
    Scene scene = read_scene(folder.path);
    std::erase_if(scene.warnings,
                  [](const std::string& warning) { return holds(warning, "listed images are missing"); });
    return scene;
  };
  const auto splits = [](const Scene& scene) {
    std::string all;
    for (const Frame& frame : scene.frames)
      all += frame.split == Split::train ? 't' : frame.split == Split::test ? 'e' : '-';
    return all;
  };
  Scene scene = read(R"("test_filenames":["./images/a.png","images/b.png","images/gone.png"])");
  CHECK(splits(scene) == "eett");
  CHECK(scene.warnings.empty());
  scene =
      read(R"("train_filenames":["images/a.png"],"test_filenames":["images/b.png"],"val_filenames":["images/c.png"])");
  CHECK(splits(scene) == "te--");
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "2 of 4 images are not used: train_filenames leaves them out"));
  write_transforms(folder.path / "again", scene);
  CHECK(splits(read_scene(folder.path / "again")) == "te--");
  CHECK(splits(read(R"("train_filenames":["images/a.png","images/d.png"])")) == "t--t");
  CHECK(splits(read(R"("val_filenames":["images/c.png"])")) == "ttet");
  CHECK(splits(read(R"("test_filenames":["images/b.png"],"val_filenames":["images/c.png"])")) == "te-t");
  scene = read(R"("test_filenames":["a.png","b.png"])");
  CHECK(splits(scene) == "tttt");
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "transforms.json: 2 names in test_filenames are the file_path of no frame (a.png, "));
  CHECK(holds(scene.warnings[0], "such as images/a.png"));
}

TEST_CASE("links to folders and to images are followed wherever they lead") {
  const Capture outside;
  const Capture folder;
  outside.image("photos/real.png", 8, 6, {1, 2, 3});
  outside.image("mask.png", 8, 6, {0});
  fs::copy_file(outside.path / "mask.png", outside.path / "5c1e2f");  // as caches name their files
  fs::create_directory_symlink(outside.path / "photos", folder.path / "images");
  fs::create_symlink("images/real.png", folder.path / "near.png");
  fs::create_symlink(outside.path / "5c1e2f", folder.path / "mask.png");
  folder.text_file("transforms.json", capture(frame("images/real.png", kPose, R"(,"mask_path":"mask.png")") + "," +
                                              frame("near.png") + "," + frame("mask.png")));
  const Pixels pixels = load_images(read_scene(folder.path), Split::train);
  REQUIRE(pixels.frames.size() == 3);
  CHECK(pixels.frames[0].rgba[0] == 1);
  CHECK(pixels.frames[0].mask[0] == 0);
  CHECK(pixels.frames[2].rgba[0] == 0);
}

TEST_CASE("links to what is no image are refused without a word of its content") {
  const Capture outside;
  const Capture folder;
  const std::string secret = "password hunter2";
  outside.text_file("secret", secret);
  REQUIRE(mkfifo((outside.path / "pipe").c_str(), 0600) == 0);
  folder.text_file("transforms.json", capture(frame("a.png")));
  for (const fs::path& target :
       {outside.path / "secret", outside.path / "pipe", fs::path("/dev/zero"), fs::path("/dev/tty"),
        fs::path("/proc/self/environ"), outside.path, fs::path("a.png")}) {
    CAPTURE(target);
    fs::remove(folder.path / "a.png");
    fs::create_symlink(target, folder.path / "a.png");
    const std::string message = error_of([&] { load_images(read_scene(folder.path), Split::train); });
    CHECK_MESSAGE(holds(message, "a.png: "), message);
    CHECK_FALSE(holds(message, "hunter2"));
  }
  fs::remove(folder.path / "a.png");
  fs::create_symlink(outside.path / "gone.png", folder.path / "a.png");
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "a.png is a link to a missing file"));
  for (const char* name : {"transforms.json", "rig.json"}) {
    fs::remove(folder.path / "transforms.json");
    fs::create_symlink(outside.path / "secret", folder.path / name);
    const std::string message = error_of([&] { read_scene(folder.path); });
    CHECK_MESSAGE(holds(message, "the file that this link leads to"), message);
    CHECK_FALSE(holds(message, "pass"));
  }
}

TEST_CASE("images that are missing by their names alone are named with the names they have") {
  const Capture folder;
  folder.image("Images/a.png", 8, 6, {1, 2, 3});
  folder.image("images/c.png", 8, 6, {1, 2, 3});
  fs::rename(folder.path / "images/c.png", folder.path / "images/C.PNG");
  folder.text_file("images/d.heic", "");
  folder.image("elsewhere/e.png", 8, 6, {1, 2, 3});
  folder.image("there.png", 8, 6, {1, 2, 3});
  const auto warned = [&](const std::string& names) {
    folder.text_file("transforms.json", capture(frame("there.png") + "," + names));
    return read_scene(folder.path).warnings.at(0);
  };
  CHECK(holds(warned(frame("images/c.png")), "images/C.PNG is there instead of images/c.png: rename the files"));
  CHECK(holds(warned(frame("images/a.png")), "Images/a.png is there instead of images/a.png"));
  CHECK(holds(warned(frame("images/c.jpg") + "," + frame("images/a.png")), "(and 1 more like it)"));
  CHECK(holds(warned(frame("images/d.jpg")), "images/d.heic is there instead of images/d.jpg: convert HEIC"));
  CHECK(holds(warned(frame("photos/e.png")), "elsewhere/e.png is there instead of photos/e.png"));
  CHECK(holds(warned(frame("images\\\\c.png")), "images/C.PNG is there instead of images\\c.png"));
  CHECK(holds(warned(frame("e.png")), "elsewhere/e.png is there instead of e.png"));
  CHECK_FALSE(holds(warned(frame("images/e.png")), "instead"));  // the folder is right, so another folder's is another
  folder.image("images/a b.png", 8, 6, {1, 2, 3});
  folder.image("images/Ce\u0301zanne.png", 8, 6, {1, 2, 3});  // as macOS writes an e with an accent
  CHECK(holds(warned(frame("images/a%20b.png")), "images/a b.png is there instead of images/a%20b.png"));
  CHECK(holds(warned(frame("images/C\u00e9zanne.png")),
              "zanne.png is there instead of images/C\u00e9zanne.png: the accents"));
  CHECK_FALSE(holds(warned(frame("images/Cezannes.png")), "instead"));
  folder.text_file("notes.txt", "");
  CHECK_FALSE(holds(warned(frame("words/notes.png")), "instead"));  // no image
  fs::create_directories(folder.path / "photos");
  CHECK(holds(warned(frame("photos/e.png")), "elsewhere/e.png is there instead of photos/e.png"));
  CHECK(near_misses(folder.path, {"photos/e.png"}, false).empty());
  CHECK(near_misses(folder.path, {"there.png"}).empty());  // never the file itself
  folder.text_file("transforms.json", capture(frame("images/c.png")));
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "images/C.PNG is there instead"));
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

TEST_CASE("transforms.json cut short at any byte gives an Error, never anything else") {
  const Capture folder;
  folder.image("a.png", 8, 6, {1, 2, 3});
  const std::string all = capture(frame("a.png", kPose, R"(,"mask_path":"a.png","k1":NaN)"));
  for (std::size_t length = 0; length <= all.size(); ++length) {
    folder.text_file("transforms.json", all.substr(0, length));
    CHECK_THROWS_AS(read_scene(folder.path), Error);
  }
}

TEST_CASE("transforms.json with any byte replaced reads or gives an Error") {
  const Capture folder;
  folder.image("a.png", 8, 6, {1, 2, 3});
  const std::string all = capture(frame("a.png"), R"("fl_x":10,"w":8,"h":6,"k1":0.1,"camera_model":"OPENCV")");
  for (std::size_t at = 0; at < all.size(); ++at) {
    for (const char put : {'0', '9', '"', '-', ']', '{', 'N', '\0', '\xff'}) {
      std::string changed = all;
      changed[at] = put;
      folder.text_file("transforms.json", changed);
      try {
        load_images(read_scene(folder.path), Split::train);
      } catch (const Error&) {}
    }
  }
}

TEST_CASE("damaged images stop the load with the file named, or are dropped") {
  const Capture folder;
  folder.image("a.png", 8, 6, {1, 2, 3});
  folder.image("b.png", 8, 6, {1, 2, 3});
  fs::resize_file(folder.path / "b.png", fs::file_size(folder.path / "b.png") - 20);
  folder.text_file("transforms.json", capture(frame("a.png") + "," + frame("b.png")));
  const Scene scene = read_scene(folder.path);
  CHECK(holds(error_of([&] { load_images(scene, Split::train); }), "b.png"));
  const Pixels rest = load_images(scene, Split::train, {1, true});
  CHECK(rest.frames.size() == 1);
  CHECK(rest.warnings.size() == 1);
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
