// COLMAP's models: a small one written here byte by byte, every lens against its published formula, a real capture, and
// damage.
#include "models/data/colmap.h"

#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <random>
#include <set>

#include "models/data/colmap_model.h"
#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/io/image.h"
#include "models/runs/scene_file.h"
#include "runtime/error.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

void write_bytes(const fs::path& path, const std::string& content) {
  fs::create_directories(path.parent_path());
  std::ofstream(path, std::ios::binary) << content;
}

void write_image(const fs::path& path, int width, int height) {
  fs::create_directories(path.parent_path());
  write_png(path, {width, height, 3, std::vector<std::uint8_t>(std::size_t(3) * width * height, 90)});
}

// Numbers one after another, as the binary files have them.
class Bytes {
 public:
  template <class Value>
  Bytes& add(std::initializer_list<Value> values) {
    for (const Value value : values) content.append(reinterpret_cast<const char*>(&value), sizeof value);
    return *this;
  }
  Bytes& u8(std::initializer_list<std::uint8_t> values) { return add(values); }
  Bytes& u32(std::initializer_list<std::uint32_t> values) { return add(values); }
  Bytes& u64(std::initializer_list<std::uint64_t> values) { return add(values); }
  Bytes& f64(std::initializer_list<double> values) { return add(values); }
  Bytes& name(const std::string& name) {
    content += name + '\0';
    return *this;
  }
  std::string content;
};

using Files = std::map<std::string, std::string>;

constexpr std::uint64_t kNone = ~std::uint64_t{0};

// Three images by two cameras; the second stands at (1, 2, 3) and looks along the world's x. Of the points the second
// was found nowhere and the third is no place.
Files binary_model() {
  const double half = std::sqrt(0.5);
  Bytes cameras, images, points;
  cameras.u64({2});
  cameras.u32({7, 2}).u64({8, 6}).f64({10, 4, 3, 0.1});
  cameras.u32({3, 5}).u64({4, 4}).f64({5, 6, 2, 2, 0.01, 0.02, 0.03, 0.04});
  images.u64({3});
  images.u32({1}).f64({half, 0, -half, 0, 3, -2, -1}).u32({3}).name("left/b c.png");
  images.u64({2}).f64({1.5, 2.5}).u64({kNone}).f64({2, 2}).u64({40});
  images.u32({2}).f64({2, 0, 0, 0, 0, 0, 0}).u32({7}).name("a.png");
  images.u64({1}).f64({4, 3}).u64({10});
  images.u32({9}).f64({1, 0, 0, 0, 0, 0, 5}).u32({7}).name("gone.png").u64({0});
  points.u64({4});
  points.u64({10}).f64({0, 0, 4}).u8({1, 2, 3}).f64({0.5}).u64({1}).u32({2, 0});
  points.u64({20}).f64({0, 0, 9}).u8({1, 1, 1}).f64({0.5}).u64({0});
  points.u64({30}).f64({0, kNan, 0}).u8({1, 1, 1}).f64({0.5}).u64({1}).u32({2, 0});
  points.u64({40}).f64({6, 2, 3}).u8({4, 5, 255}).f64({0.5}).u64({2}).u32({1, 1, 2, 0});
  return {{"cameras.bin", cameras.content}, {"images.bin", images.content}, {"points3D.bin", points.content}};
}

// The same, with the comments and the empty line that COLMAP writes.
Files text_model() {
  return {{"cameras.txt",
           "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
           "7 SIMPLE_RADIAL 8 6 10 4 3 0.1\r\n3 OPENCV_FISHEYE 4 4 5 6 2 2 0.01 0.02 0.03 0.04\n"},
          {"images.txt",
           "# Image list with two lines of data per image:\n"
           "1 0.70710678118654757 0 -0.70710678118654757 0 3 -2 -1 3 left/b c.png\n1.5 2.5 -1 2 2 40\n"
           "2 2 0 0 0 0 0 0 7 a.png\r\n4 3 10\r\n"
           "9 1 0 0 0 0 0 5 7 gone.png\n\n"},
          {"points3D.txt",
           "# 3D point list\n10 0 0 4 1 2 3 0.5 2 0\n20 0 0 9 1 1 1 0.5\n30 0 nan 0 1 1 1 0.5 2 0\n"
           "40 6 2 3 4 5 255 0.5 1 1 2 0"}};
}

void write_model(const fs::path& folder, const Files& files) {
  for (const auto& [name, content] : files) write_bytes(folder / name, content);
}

void write_images(const Folder& folder) {
  write_image(folder.path / "images/a.png", 8, 6);
  write_image(folder.path / "images/left/b c.png", 4, 4);
}

void check_small_scene(const Scene& scene) {
  CHECK(scene.format == "COLMAP");
  CHECK(scene.frames_listed == 3);
  REQUIRE(scene.frames.size() == 2);  // by name
  CHECK(scene.frames[0].name == "a.png");
  CHECK(scene.frames[1].image == "images/left/b c.png");
  REQUIRE(scene.cameras.size() == 2);
  CHECK(scene.cameras[0] == Camera{8, 6, 10, 10, 4, 3, CameraModel::opencv, {0.1, 0, 0, 0}});
  CHECK(scene.cameras[1] == Camera{4, 4, 5, 6, 2, 2, CameraModel::fisheye, {0.01, 0.02, 0.03, 0.04}});
  CHECK(scene.frames[0].world_from_camera.isApprox(Eigen::Matrix4d::Identity(), 1e-12));
  const Eigen::Matrix4d& pose = scene.frames[1].world_from_camera;
  CHECK(pose.col(3).isApprox(Eigen::Vector4d(1, 2, 3, 1), 1e-12));
  CHECK(pose.col(2).isApprox(Eigen::Vector4d(1, 0, 0, 0), 1e-12));
  CHECK(scene.up.isApprox(Eigen::Vector3d(0, -1, 0), 1e-12));
  CHECK(scene.cloud.positions == std::vector<float>{0, 0, 4, 6, 2, 3});
  CHECK(scene.cloud.colours == std::vector<std::uint8_t>{1, 2, 3, 4, 5, 255});
  REQUIRE(scene.warnings.size() == 2);
  CHECK(scene.warnings[0] == "1 of 3 listed images are missing and skipped: images/gone.png");
  CHECK(holds(scene.warnings[1], "2 of 4 points are left out"));
}

// A lens as colmap.github.io/cameras.html and COLMAP's camera_models.h define it: from (u, v) = (x, y) / z to the
// point in the image less the centre, over the focal length.
struct LensFormula {
  const char* name;
  const char* parameters;
  Eigen::Vector2d (*distorted)(double u, double v);
};

Eigen::Vector2d radial(double u, double v, double gain) { return {u * gain, v * gain}; }

Eigen::Vector2d equidistant(double u, double v) {
  const double r = std::hypot(u, v);
  return {u * std::atan(r) / r, v * std::atan(r) / r};
}

const LensFormula kFormulas[] = {
    {"SIMPLE_PINHOLE", "30 32 24", [](double u, double v) { return radial(u, v, 1); }},
    {"PINHOLE", "30 28 32 24", [](double u, double v) { return radial(u, v, 1); }},
    {"SIMPLE_RADIAL", "30 32 24 -0.05", [](double u, double v) { return radial(u, v, 1 - 0.05 * (u * u + v * v)); }},
    {"RADIAL", "30 32 24 -0.1 0.02",
     [](double u, double v) {
       const double r2 = u * u + v * v;
       return radial(u, v, 1 - 0.1 * r2 + 0.02 * r2 * r2);
     }},
    {"OPENCV", "30 28 32 24 -0.1 0.02 0.003 -0.002",
     [](double u, double v) {
       const double r2 = u * u + v * v, gain = 1 - 0.1 * r2 + 0.02 * r2 * r2;
       return Eigen::Vector2d(u * gain + 2 * 0.003 * u * v - 0.002 * (r2 + 2 * u * u),
                              v * gain + 2 * -0.002 * u * v + 0.003 * (r2 + 2 * v * v));
     }},
    {"OPENCV_FISHEYE", "30 28 32 24 0.05 -0.01 0.002 -0.0003",
     [](double u, double v) {
       const double r = std::hypot(u, v), t = std::atan(r), t2 = t * t;
       return radial(u, v,
                     t / r * (1 + 0.05 * t2 - 0.01 * t2 * t2 + 0.002 * t2 * t2 * t2 - 0.0003 * t2 * t2 * t2 * t2));
     }},
    {"FULL_OPENCV", "30 28 32 24 0.4 0.1 0.003 -0.002 0.02 0.5 0.15 0.01",
     [](double u, double v) {
       const double r2 = u * u + v * v, r4 = r2 * r2, r6 = r4 * r2;
       const double gain = (1 + 0.4 * r2 + 0.1 * r4 + 0.02 * r6) / (1 + 0.5 * r2 + 0.15 * r4 + 0.01 * r6);
       return Eigen::Vector2d(u * gain + 2 * 0.003 * u * v - 0.002 * (r2 + 2 * u * u),
                              v * gain + 2 * -0.002 * u * v + 0.003 * (r2 + 2 * v * v));
     }},
    {"FOV", "30 28 32 24 0.9",
     [](double u, double v) {
       const double r = std::hypot(u, v);
       return radial(u, v, std::atan(2 * r * std::tan(0.45)) / (0.9 * r));
     }},
    {"SIMPLE_RADIAL_FISHEYE", "30 32 24 0.05",
     [](double u, double v) {
       const Eigen::Vector2d e = equidistant(u, v);
       return Eigen::Vector2d(e * (1 + 0.05 * e.squaredNorm()));
     }},
    {"RADIAL_FISHEYE", "30 32 24 0.05 -0.01",
     [](double u, double v) {
       const Eigen::Vector2d e = equidistant(u, v);
       return Eigen::Vector2d(e * (1 + 0.05 * e.squaredNorm() - 0.01 * e.squaredNorm() * e.squaredNorm()));
     }},
    {"THIN_PRISM_FISHEYE", "30 28 32 24 0.05 -0.01 0.003 -0.002 0.002 -0.0003 0.004 -0.005",
     [](double u, double v) {
       const Eigen::Vector2d e = equidistant(u, v);
       const double x = e.x(), y = e.y(), r2 = e.squaredNorm(), r4 = r2 * r2;
       const double gain = 1 + 0.05 * r2 - 0.01 * r4 + 0.002 * r4 * r2 - 0.0003 * r4 * r4;
       return Eigen::Vector2d(x * gain + 2 * 0.003 * x * y - 0.002 * (r2 + 2 * x * x) + 0.004 * r2,
                              y * gain + 2 * -0.002 * x * y + 0.003 * (r2 + 2 * y * y) - 0.005 * r2);
     }},
};

Camera camera_of(const LensFormula& lens) {
  const Folder folder;
  write_bytes(folder.path / "cameras.txt", text("1 ", lens.name, " 64 48 ", lens.parameters, "\n"));
  write_bytes(folder.path / "images.txt", "");
  return read_colmap_model(folder.path).cameras.at(1);
}

double focal_x(const Camera& camera, double at) { return (at - camera.cx) / camera.fx; }
double focal_y(const Camera& camera, double at) { return (at - camera.cy) / camera.fy; }

}  // namespace

TEST_CASE("every lens of COLMAP's follows its formula, and its inverse undoes it") {
  for (const LensFormula& lens : kFormulas) {
    CAPTURE(lens.name);
    const Camera camera = camera_of(lens);
    CHECK(camera.fx == 30);
    CHECK(camera.fy == (std::string(lens.parameters).starts_with("30 28") ? 28 : 30));
    CHECK(Eigen::Vector2d(camera.cx, camera.cy) == Eigen::Vector2d(32, 24));
    for (const Eigen::Vector2d& at : {Eigen::Vector2d(0.3, -0.2), {-0.6, 0.5}, {0.01, 0.9}, {-0.8, -0.4}}) {
      const Eigen::Vector2d seen = project(camera, Eigen::Vector3d(2 * at.x(), 2 * at.y(), 2));
      const Eigen::Vector2d wanted = lens.distorted(at.x(), at.y());
      CHECK(focal_x(camera, seen.x()) == doctest::Approx(wanted.x()).epsilon(1e-10));
      CHECK(focal_y(camera, seen.y()) == doctest::Approx(wanted.y()).epsilon(1e-10));
    }
    double worst = 0;
    for (double x = 0.5; x < 64; x += 3.5) {
      for (double y = 0.5; y < 48; y += 3.5) {
        worst = std::max(worst, (project(camera, 3 * direction(camera, {x, y})) - Eigen::Vector2d(x, y)).norm());
      }
    }
    CHECK(worst < 1e-8);
  }
}

TEST_CASE("a FOV lens and a fisheye look sideways and behind") {
  Camera camera{64, 48, 10, 10, 32, 24, CameraModel::fov, {1.2, 0, 0, 0}};
  const Eigen::Vector2d side = project(camera, {1, 0, 0});
  CHECK(side.x() == doctest::Approx(32 + 10 * (M_PI / 2) / 1.2));
  CHECK(direction(camera, side).isApprox(Eigen::Vector3d(1, 0, 0), 1e-12));
  camera.k = {1e-5, 0, 0, 0};  // towards a pinhole
  CHECK(project(camera, {1, 2, 4}).isApprox(Eigen::Vector2d(32 + 2.5, 24 + 5), 1e-8));
  for (const float value : pixel_directions(camera)) CHECK(std::isfinite(value));
}

TEST_CASE("a run's scene file keeps every lens") {
  const Folder folder;
  Scene scene;
  for (const LensFormula& lens : kFormulas) scene.cameras.push_back(camera_of(lens));
  scene.frames.resize(1);
  write_scenes(folder.path / "scene.json", {scene});
  CHECK(read_scene_file(folder.path / "scene.json").at(0).cameras == scene.cameras);
}

TEST_CASE("a downscaled lens sees the same directions") {
  for (const LensFormula& lens : kFormulas) {
    const Camera camera = camera_of(lens);
    CHECK(direction(scaled(camera, 2), {5, 7}).isApprox(direction(camera, {10, 14}), 1e-9));
    CHECK(direction(resized(camera, 128, 24), {20, 7}).isApprox(direction(camera, {10, 14}), 1e-9));
  }
}

TEST_CASE("a small COLMAP model reads the same from binary and text, wherever it lies") {
  for (const char* place : {"sparse/0", "sparse", ""}) {
    for (const Files& model : {binary_model(), text_model()}) {
      const Folder folder;
      write_images(folder);
      write_model(folder.path / place, model);
      const Scene scene = read_scene(folder.path);
      check_small_scene(scene);
      const Pixels pixels = load_images(scene, Split::train);
      CHECK(pixels.frames.size() == 2);
      CHECK(pixels.warnings.empty());
      // The centre of each camera's image is where its point was found.
      const ColmapFit fit = check_colmap(scene.root);
      CHECK(fit.points == 2);
      CHECK(fit.observations == 2);
      CHECK(fit.mean_error == doctest::Approx(0).epsilon(1e-9));
    }
  }
}

TEST_CASE("COLMAP: texts with a byte order mark, and an error that nothing tells") {
  const Folder folder;
  write_images(folder);
  Files model = text_model();
  for (auto& [name, content] : model) content = "\xef\xbb\xbf" + content;
  write_model(folder.path, model);
  check_small_scene(read_scene(folder.path));
  CHECK(error_in_words(check_colmap(folder.path)) == "0.00 px");
  fs::remove(folder.path / "points3D.txt");
  CHECK(error_in_words(check_colmap(folder.path)) == "not known");
}

TEST_CASE("COLMAP: images beside the model, several models, and no points") {
  const Folder folder;
  write_image(folder.path / "a.png", 8, 6);
  Files model = binary_model();
  model.erase("points3D.bin");
  write_model(folder.path / "sparse/0", model);
  write_model(folder.path / "sparse/1", model);
  const Scene scene = read_scene(folder.path);
  CHECK(scene.frames.size() == 1);
  CHECK(scene.cloud.count() == 0);
  CHECK(holds(scene.warnings.at(0), "sparse/ has 2 models"));
}

TEST_CASE("COLMAP: linked folders are followed, images outside of the folder need the user's leave") {
  const Folder folder, other;
  write_model(other.path / "model", text_model());
  write_images(other);
  fs::create_directories(folder.path / "sparse");
  fs::create_directory_symlink(other.path / "model", folder.path / "sparse/0");
  fs::create_directory_symlink(other.path / "images", folder.path / "images");
  check_small_scene(read_scene(folder.path));
  Files files = text_model();
  const std::string outside = (other.path / "images/a.png").string();
  files["images.txt"].replace(files["images.txt"].find("a.png"), 5, outside);
  write_model(other.path / "model", files);
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "--allow-outside"));
  CHECK(read_scene(folder.path, {false, true}).frames.at(0).image == outside);
  // What a linked file holds is not quoted.
  write_bytes(other.path / "secret", "hunter2\n");
  fs::remove(other.path / "model/cameras.txt");
  fs::create_symlink(other.path / "secret", other.path / "model/cameras.txt");
  const std::string message = error_of([&] { read_scene(folder.path); });
  CHECK_MESSAGE(holds(message, "cameras.txt: the file that this link leads to"), message);
  CHECK_FALSE(holds(message, "hunter2"));
}

TEST_CASE("what is wrong with a COLMAP model is named") {
  const Folder folder;
  write_images(folder);
  const auto attempt = [&](const std::string& file, const std::string& from, const std::string& to) {
    Files model = text_model();
    std::string& content = model.at(file);
    REQUIRE(content.find(from) != std::string::npos);
    content.replace(content.find(from), from.size(), to);
    write_model(folder.path / "sparse/0", model);
    return error_of([&] { read_scene(folder.path); });
  };
  CHECK(holds(attempt("cameras.txt", "SIMPLE_RADIAL", "SIMPLE_DIVISION"), "camera model SIMPLE_DIVISION"));
  CHECK(holds(attempt("cameras.txt", "8 6 10", "8 0 10"), "line 3: an image side of 0 pixels"));
  CHECK(holds(attempt("cameras.txt", "8 6 10", "8 6 -10"), "line 3: implausible intrinsics"));
  CHECK(holds(attempt("cameras.txt", "4 3 0.1", "4 3 nan"), "SIMPLE_RADIAL's k1 is nan"));
  CHECK(holds(attempt("cameras.txt", "4 3 0.1", "4 3"), "looked for a camera's parameter, found ''"));
  CHECK(holds(attempt("cameras.txt", "4 3 0.1", "4 3 0.1 8"), "follows the last value of the line"));
  CHECK(holds(attempt("cameras.txt", "3 OPENCV", "7 OPENCV"), "camera 7 is defined twice"));
  CHECK(holds(attempt("images.txt", "2 2 0", "2 0 0"), "quaternion"));
  CHECK(holds(attempt("images.txt", "0 0 7 a.png", "0 0 8 a.png"), "refers to camera 8"));
  CHECK(holds(attempt("images.txt", "a.png", "../../a.png"), "leaves the data folder"));
  CHECK(holds(attempt("images.txt", "a.png", "/etc/passwd.png"), "leaves the data folder"));
  CHECK(holds(attempt("images.txt", "\n1.5 2.5 -1 2 2 40\n", "\n1.5 2.5\n"), "line 3: looked for a point in an image"));
  CHECK(holds(attempt("points3D.txt", "4 5 255", "4 5 256"), "looked for a point's colour, found '256'"));
  const Scene rest = [&] {
    Files model = text_model();
    model.at("images.txt").replace(model.at("images.txt").find("2 2 0"), 5, "2 0 0");
    write_model(folder.path / "sparse/0", model);
    return read_scene(folder.path, {true});
  }();
  CHECK(rest.frames.size() == 1);
  CHECK(holds(rest.warnings.at(0), "frame dropped"));
}

TEST_CASE("a COLMAP model cut short at any byte is an error") {
  const Folder folder;
  write_images(folder);
  for (const auto& [name, content] : binary_model()) {
    write_model(folder.path / "sparse/0", binary_model());
    for (std::size_t length = 0; length < content.size(); ++length) {
      write_bytes(folder.path / "sparse/0" / name, content.substr(0, length));
      CHECK(error_of([&] { read_scene(folder.path); }) != "no error");
    }
  }
  fs::remove_all(folder.path / "sparse");
  for (const auto& [name, content] : text_model()) {
    write_model(folder.path / "sparse/0", text_model());
    for (std::size_t length = 0; length < content.size(); ++length) {
      write_bytes(folder.path / "sparse/0" / name, content.substr(0, length));
      error_of([&] { read_scene(folder.path); });  // a file that ends between two records is a shorter one
    }
  }
}

TEST_CASE("a COLMAP model with changed bytes reads or is an error") {
  const Folder folder;
  write_images(folder);
  std::mt19937 random(6);
  const Files whole = binary_model();
  for (int i = 0; i < 200; ++i) {
    Files model = whole;
    for (auto& [name, content] : model) content[random() % content.size()] = static_cast<char>(random());
    write_model(folder.path / "sparse/0", model);
    error_of([&] { load_images(read_scene(folder.path), Split::train); });
    error_of([&] { check_colmap(folder.path); });
  }
}

TEST_CASE("counts that a file cannot hold are refused before memory is asked for") {
  const Folder folder;
  write_images(folder);
  for (const auto& [name, content] : binary_model()) {
    for (const std::uint64_t promised : {std::uint64_t{5}, std::uint64_t{1} << 40, kNone}) {
      Files model = binary_model();
      model.at(name) = Bytes().u64({promised}).content + content.substr(8);
      write_model(folder.path / "sparse/0", model);
      const std::string message = error_of([&] { read_scene(folder.path); });
      CHECK_MESSAGE((holds(message, "declared") || holds(message, "ends in the middle")), message);
    }
    Files model = binary_model();
    model.at(name) += "more";
    write_model(folder.path / "sparse/0", model);
    CHECK(holds(error_of([&] { read_scene(folder.path); }), "4 bytes follow"));
  }
}

TEST_CASE("fox_colmap: every point appears where it was found in the images") {
  const fs::path root = test_data("fox_colmap");
  if (no_data(root)) return;
  const Scene scene = read_scene(root);
  CHECK(scene.frames.size() == 50);
  CHECK(scene.frames[0].image == "images/0001.jpg");
  CHECK(scene.cloud.count() == 12342);
  REQUIRE(scene.cameras.size() == 1);
  CHECK(scene.cameras[0].width == 359);
  CHECK(scene.cameras[0].model == CameraModel::pinhole);
  CHECK(scene.warnings.empty());
  CHECK(check_scene(scene).empty());

  const ColmapModel model = read_colmap_model(root / "sparse/0", true);
  std::map<std::uint64_t, ColmapPoint> points;
  for (const ColmapPoint& point : model.points) points[point.id] = point;
  double sum = 0, worst = 0, recorded = 0;
  Eigen::Vector2d shift = Eigen::Vector2d::Zero();
  std::set<std::uint64_t> found;
  std::size_t count = 0;
  for (const ColmapImage& image : model.images) {
    const auto frame = std::find_if(scene.frames.begin(), scene.frames.end(),
                                    [&](const Frame& one) { return one.name == image.name; });
    REQUIRE(frame != scene.frames.end());
    const Eigen::Isometry3d camera_from_world = Eigen::Isometry3d(frame->world_from_camera).inverse();
    for (const ColmapObservation& seen : image.observations) {
      const ColmapPoint& point = points.at(seen.point);
      const Eigen::Vector3d place = camera_from_world * point.position;
      CHECK(place.z() > 0);
      const Eigen::Vector2d error = project(scene.cameras[0], place) - seen.pixel;
      shift += error;
      worst = std::max(worst, error.norm());
      sum += error.norm();
      recorded += point.error;
      found.insert(seen.point);
      ++count;
    }
  }
  MESSAGE("observations ", count, ", mean error ", sum / count, " pixels, worst ", worst, ", shift ",
          shift.norm() / count);
  CHECK(found.size() == 12342);
  CHECK(sum / count < 0.5);
  CHECK(worst < 3);
  CHECK(shift.norm() / count < 0.05);                         // pixel centres: half a pixel would be 0.7
  CHECK(recorded / sum == doctest::Approx(3).epsilon(0.02));  // COLMAP's figures are of photos three times as large
}
