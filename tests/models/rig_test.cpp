// The plain layout for one's own car (rig.json), and the point files that it names.
#include "models/data/rig.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "models/data/check_log.h"
#include "models/data/load_images.h"
#include "models/data/load_sweep.h"
#include "models/data/read_scene.h"
#include "models/io/image.h"
#include "models/io/json.h"
#include "models/io/ply.h"
#include "models/runs/recorded_log.h"
#include "models/scene/split.h"
#include "runtime/error.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"
#include "tests/models/told.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

template <class Value>
std::string raw(const std::vector<Value>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Value)};
}

// A sensor at height z, turned by a quarter about z: its x is the world's y.
std::string pose(double x, double y, double z) {
  return "[[0, -1, 0, " + std::to_string(x) + "], [1, 0, 0, " + std::to_string(y) + "], [0, 0, 1, " +
         std::to_string(z) + "], [0, 0, 0, 1]]";
}

// Three sweeps, each in another kind of file, two cameras, the left of which takes twice as many images; a car whose
// box is given in both ways. What the LiDAR sees at (1, 2, 3) lies at (x - 2, 1, 3 + z) in the world.
const char* const kRig = R"({
  "cameras": {
    "front": {"w": 16, "h": 12, "fl_x": 10, "cx": 8.5},
    "left": {"w": 16, "h": 12, "fl_x": 10, "k1": 0.1}
  },
  "frames": [
    {"image": "front/0.png", "camera": "front", "timestamp": 100.01, "world_from_camera": POSE0},
    {"image": "front/1.png", "camera": "front", "timestamp": 100.11, "world_from_camera": POSE1},
    {"image": "left/0.png", "camera": "left", "timestamp": 99.99, "world_from_camera": POSE0},
    {"image": "left/1.png", "camera": "left", "timestamp": 100.04, "world_from_camera": POSE0},
    {"image": "left/2.png", "camera": "left", "timestamp": 100.21, "world_from_camera": POSE1}
  ],
  "sweeps": [
    {"points": "lidar/1.npy", "timestamp": 100.1, "world_from_lidar": POSE1},
    {"points": "lidar/0.ply", "timestamp": 100.0, "world_from_lidar": POSE0},
    {"points": "lidar/2.ply", "timestamp": 100.2, "world_from_lidar": POSE1, "points_in_world": true}
  ],
  "actors": [
    {"id": "car-1", "label": "Car", "size": [1.8, 4.4, 1.5], "boxes": [
      {"timestamp": 100.2, "world_from_box": POSE1},
      {"timestamp": 100.0, "position": [-2, 1, 4], "yaw": 1.5707963267948966},
      {"timestamp": 107.0, "position": [-2, 1, 4], "yaw": 0}]}
  ]
})";

std::string replaced(std::string content, const std::string& from, const std::string& to) {
  for (std::size_t at = content.find(from); at != std::string::npos; at = content.find(from, at + to.size())) {
    content.replace(at, from.size(), to);
  }
  return content;
}

std::string rig_text() { return replaced(replaced(kRig, "POSE0", pose(0, 0, 1)), "POSE1", pose(5, 0, 1)); }

std::string ascii_ply() {
  return "ply\r\nformat ascii 1.0\ncomment made by hand\nelement vertex 3\nproperty float x\nproperty float y\n"
         "property double z\nproperty uchar intensity\nelement face 1\nproperty list uchar int vertex_indices\n"
         "end_header\n1 2 3 51\n-1.5 2e1 0 255\nnan 0 0 0\n3 0 1 2\n";
}

std::string binary_ply(const std::string& vertices = "2") {
  return "ply\nformat binary_little_endian 1.0\nelement vertex " + vertices +
         "\nproperty double x\nproperty double y\nproperty double z\nproperty float intensity\nproperty float time\n"
         "end_header\n" +
         raw<double>({3, 1, 4}) + raw<float>({0.25, -0.05F}) + raw<double>({7, 8, 9}) + raw<float>({2, 0});
}

std::string npy() {
  std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 4), }";
  header += std::string(117 - header.size(), ' ') + '\n';
  return std::string("\x93NUMPY\x01\x00\x76\x00", 10) + header + raw<float>({1, 2, 3, 0.5, 10, 20, 30, 1});
}

void write_rig(const fs::path& root) {
  write_text(root / "rig.json", rig_text());
  write_text(root / "lidar/0.ply", ascii_ply());
  write_text(root / "lidar/1.npy", npy());
  write_text(root / "lidar/2.ply", binary_ply());
  for (const char* image : {"front/0.png", "front/1.png", "left/0.png", "left/1.png", "left/2.png"}) {
    fs::create_directories((root / image).parent_path());
    write_png(root / image, {16, 12, 3, std::vector<std::uint8_t>(3 * 16 * 12, 90)});
  }
}

}  // namespace

TEST_CASE("rig: written in PandaSet's layout, boxes are where their actors are at the times of the sweeps") {
  const Folder folder;
  write_rig(folder.path / "rig");
  std::string rig = content_of(folder.path / "rig/rig.json");
  // The car's boxes 40 ms after the sweeps, and tilted.
  rig = replaced(
      rig, "\"timestamp\": 100.0, \"position\": [-2, 1, 4], \"yaw\": 1.5707963267948966}",
      "\"timestamp\": 100.04, \"world_from_box\": [[0.8, -0.6, 0, 1], [0.6, 0.8, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]}");
  rig = replaced(rig, "{\"timestamp\": 100.2, \"world_from_box\": " + pose(5, 0, 1),
                 "{\"timestamp\": 100.14, \"world_from_box\": [[0.8, -0.6, 0, 3], [0.48, 0.64, -0.6, 2], [0.36, 0.48, "
                 "0.8, 3], [0, 0, 0, 1]]}, {\"timestamp\": 100.24, \"world_from_box\": " +
                     pose(5, 0, 1));
  write_text(folder.path / "rig/rig.json", rig);
  Scene given = read_scene(folder.path / "rig");
  REQUIRE(given.actors.at(0).boxes.size() == 3);
  Told told;
  write_recorded_log(folder.path / "log", given, false, told.listener());
  const Scene log = read_scene(folder.path / "log");
  REQUIRE(log.actors.size() == 1);
  for (const Sweep& sweep : log.sweeps) {
    const auto is = world_from_box_at(log.actors[0], sweep.timestamp),
               was = world_from_box_at(given.actors[0], sweep.timestamp);
    REQUIRE((is && was));
    CHECK((*is - *was).norm() < 1e-6);
  }
  CHECK_MESSAGE(holds(told.said, "the camera front is written as front_camera"), told.said);
  Scene lenses = given;
  lenses.cameras.push_back(lenses.cameras[0]);
  lenses.cameras.back().fx *= 1.1;
  lenses.frames[1].camera = 2;
  CHECK(holds(error_of([&] { write_recorded_log(folder.path / "two", lenses, false, told.listener()); }, Fault::usage),
              "one lens for each camera"));
  CHECK_FALSE(fs::exists(folder.path / "two"));
}

TEST_CASE("rig: images, points and boxes by steps") {
  const Folder folder;
  write_rig(folder.path);
  Scene scene = read_scene(folder.path);
  CHECK(scene.format == "rig");
  CHECK(scene.is_log);
  CHECK(scene.metric);
  CHECK_FALSE(scene.night);
  REQUIRE(scene.frames.size() == 4);
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "1 of 5 images are left out"));
  const char* images[] = {"front/0.png", "front/1.png", "left/0.png", "left/2.png"};  // left/1.png is later
  const int steps[] = {0, 1, 0, 2};
  for (std::size_t i = 0; i < 4; ++i) {
    CHECK(scene.frames[i].image == images[i]);
    CHECK(scene.frames[i].step == steps[i]);
  }
  CHECK(scene.frames[1].sensor == "front");
  CHECK(*scene.frames[1].timestamp == 100.11);
  CHECK(scene.frames[1].world_from_camera(0, 3) == 5);
  CHECK(scene.cameras[0] == Camera{16, 12, 10, 10, 8.5, 6, CameraModel::pinhole, {}, 0, 0});
  CHECK(scene.cameras[1].model == CameraModel::opencv);
  REQUIRE(scene.sweeps.size() == 3);
  LidarPoints points = load_sweep(scene, scene.sweeps[0]);  // the earliest, though listed second
  CHECK(points.positions == std::vector<float>{-2, 1, 4, -20, -1.5, 1});
  CHECK(points.intensities == std::vector<float>{0.2F, 1});
  CHECK(points.dropped == 1);
  points = load_sweep(scene, scene.sweeps[1]);
  CHECK(points.positions == std::vector<float>{3, 1, 4, -15, 10, 31});
  CHECK(points.intensities == std::vector<float>{0.5, 1});
  points = load_sweep(scene, scene.sweeps[2]);
  CHECK(points.positions == std::vector<float>{3, 1, 4, 7, 8, 9});
  CHECK(points.times == std::vector<float>{-0.05F, 0});
  REQUIRE(scene.actors.size() == 1);
  const Actor& car = scene.actors[0];
  CHECK(car.size == Eigen::Vector3d(1.8, 4.4, 1.5));
  REQUIRE(car.boxes.size() == 2);  // none at 107 s
  CHECK(car.boxes[0].step == 0);
  CHECK((car.boxes[0].world_from_box.col(1) - Eigen::Vector4d(-1, 0, 0, 0)).norm() < 1e-12);  // yaw: to the left
  CHECK(car.boxes[1].step == 2);
  CHECK(car.boxes[1].world_from_box(0, 3) == 5);
  const LogReport report = check_log(scene);
  CHECK(report.boxes == 2);
  CHECK(report.boxes_without_points == 1);
  CHECK(report.fits.size() == 2);
  CHECK(report.rate == doctest::Approx(10));
  CHECK(load_images(scene, Split::train).frames.size() == 4);
  apply_holdout(scene, 2);
  for (const Frame& frame : scene.frames) CHECK((frame.split == Split::test) == (frame.step != 1));
  for (const Sweep& sweep : scene.sweeps) CHECK((sweep.split == Split::test) == (sweep.step != 1));
}

TEST_CASE("rig: without sweeps the camera with most images counts the steps; what is missing is warned of") {
  const Folder folder;
  write_rig(folder.path);
  Json rig = parse_json_file(folder.path / "rig.json");
  fs::remove(folder.path / "lidar/1.npy");
  CHECK(read_scene(folder.path).sweeps.size() == 2);
  CHECK(holds(read_scene(folder.path).warnings.back(), "lidar/1.npy"));
  rig.erase("sweeps");
  write_text(folder.path / "rig.json", rig.dump());
  Scene scene = read_scene(folder.path);
  CHECK(scene.frames.size() == 5);
  CHECK(scene.frames[4].step == 2);
  fs::remove(folder.path / "left/2.png");
  scene = read_scene(folder.path);
  CHECK(scene.frames.size() == 3);  // now the front camera counts, and left/1.png is one too many
  REQUIRE(scene.warnings.size() == 3);
  CHECK(holds(scene.warnings[1], "left/2.png"));
  CHECK(scene.warnings[2] == "no LiDAR sweeps: looked for sweeps in rig.json");
  rig["frames"] = Json::array();
  write_text(folder.path / "rig.json", rig.dump());
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "no usable image: 0 listed in rig.json"));
}

TEST_CASE("rig: errors name the key") {
  const Folder folder;
  write_rig(folder.path);
  const std::string sound = rig_text();
  const auto error_with = [&](const std::string& from, const std::string& to) {
    std::string content = sound;
    const std::size_t at = content.find(from);
    REQUIRE(at != std::string::npos);
    write_text(folder.path / "rig.json", content.replace(at, from.size(), to));
    return error_of([&] { read_scene(folder.path); });
  };
  CHECK(holds(error_with("\"front\",", "\"fornt\","),
              "frames[0]: camera is fornt, which is not defined in cameras; did you mean front?"));
  CHECK(holds(error_with("100.01", "\"now\""), "rig.json: frames[0]: timestamp is string"));
  CHECK(holds(error_with("100.01", "NaN"), "rig.json: frames[0]: timestamp is null"));
  CHECK(holds(error_with("\"fl_x\": 10", "\"fl_x\": 0"), "rig.json: cameras: front"));
  CHECK(holds(error_with("\"fl_x\": 10,", ""), "no focal length"));
  for (const char* outside : {"../0.png", "/etc/passwd"}) {
    CHECK(holds(error_with("front/0.png", outside), "--allow-outside"));
    CHECK(holds(error_with("lidar/0.ply", outside), "--allow-outside"));
  }
  CHECK(holds(error_with("lidar/1.npy", "lidar/1.pkl"), "sweeps[0]: points is lidar/1.pkl, want a .ply or .npy"));
  CHECK(holds(error_with("\"points_in_world\": true", "\"points_in_world\": 1"), "sweeps[2]: points_in_world"));
  CHECK(holds(error_with("100.1,", "100.0,"), "two sweeps have the timestamp 100"));
  CHECK(holds(error_with("5.000000", "500000"), "subtract one offset"));
  CHECK(holds(error_with("\"world_from_camera\": [[0, -1", "\"world_from_camera\": [[0, -3"), "frames[0]"));
  CHECK(holds(error_with("[1.8, 4.4, 1.5]", "[1.8, 4.4]"), "actors[0]: size is not a list of 3"));
  CHECK(holds(error_with("[1.8, 4.4, 1.5]", "[1.8, 4.4, -1]"), "actors[0].boxes[1]: implausible box size"));
  CHECK(holds(error_with("\"position\"", "\"place\""), "actors[0].boxes[1]: the key position is missing"));
  CHECK(holds(error_with("\"yaw\": 0", "\"yaw\": null"), "actors[0].boxes[2]: yaw is null"));
  CHECK(holds(error_with("\"boxes\"", "\"box\""), "actors[0]: the key boxes is missing"));
  CHECK(holds(error_with("\"cameras\"", "\"camera\""), "rig.json: the key cameras is missing"));
  // Images of another clock.
  std::string content = sound;
  for (const char* time : {"100.01", "100.11", "99.99", "100.04", "100.21"}) content = replaced(content, time, "5");
  write_text(folder.path / "rig.json", content);
  CHECK(holds(error_of([&] { read_scene(folder.path); }),
              "which run from 100 to 100.2 s: do both come from the same clock"));
  for (std::size_t size = 0; size + 1 < sound.size(); size += 11) {
    write_text(folder.path / "rig.json", sound.substr(0, size));
    CHECK(error_of([&] { read_scene(folder.path); }) != "no error");
  }
}

TEST_CASE("rig: images and points outside of the folder are read where the user allows it") {
  const Folder folder, other;
  write_rig(folder.path);
  fs::rename(folder.path / "front", other.path / "front");
  fs::rename(folder.path / "lidar", other.path / "lidar");
  const std::string up = "../" + other.path.filename().string() + "/";
  write_text(folder.path / "rig.json", replaced(replaced(rig_text(), "\"lidar/", "\"" + up + "lidar/"), "\"front/",
                                                "\"" + other.path.string() + "/front/"));
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "--allow-outside"));
  const Scene scene = read_scene(folder.path, {false, true});
  CHECK(scene.frames.at(0).image == (other.path / "front/0.png").string());
  CHECK(load_images(scene, Split::train).frames.size() == scene.frames.size());
  REQUIRE(scene.sweeps.size() == 3);
  CHECK(scene.sweeps[0].file == up + "lidar/0.ply");
  CHECK(load_sweep(scene, scene.sweeps[0]).size() == 2);
}

TEST_CASE("ply: hostile and foreign files are named, nothing is allocated for them") {
  const Folder folder;
  const auto error_for = [&](const std::string& content) {
    std::ofstream(folder.path / "a.ply", std::ios::binary) << content;
    return error_of([&] { read_ply_vertices(folder.path / "a.ply"); });
  };
  CHECK(error_for(binary_ply()) == "no error");
  for (std::size_t size = 0; size < binary_ply().size(); ++size) {
    CHECK(holds(error_for(binary_ply().substr(0, size)), "a.ply: "));
  }
  const std::size_t needed = ascii_ply().find("nan 0 0 0") + 8;
  for (std::size_t size = 0; size < needed; ++size) CHECK(error_for(ascii_ply().substr(0, size)) != "no error");
  CHECK(holds(error_for(binary_ply("4000000000000")), "4000000000000 vertices of at least 32 bytes are declared"));
  CHECK(holds(error_for(binary_ply("-1")), "the number of vertices is -1"));
  CHECK(holds(error_for(binary_ply("99999999999999999999999")), "the number of vertices"));
  CHECK(holds(error_for(replaced(binary_ply(), "little", "big")), "want ascii or binary_little_endian"));
  CHECK(holds(error_for(replaced(ascii_ply(), "uchar intensity", "list uchar int intensity")), "of type list"));
  CHECK(holds(error_for(replaced(ascii_ply(), "float y", "float x")), "the property x appears twice"));
  CHECK(holds(error_for(replaced(ascii_ply(), "2e1", "two")), "vertex 1: 'two' is not a number"));
  CHECK(holds(error_for(replaced(ascii_ply(), "1 2 3 51", "1 2 3")), "vertex 0 has 3 numbers, want 4"));
  CHECK(holds(error_for(replaced(ascii_ply(), "vertex 3", "point 3")), "its first element is point"));
  CHECK(holds(error_for("ply\nformat ascii 1.0\nend_header\n"), "no element 'vertex'"));
  CHECK(holds(error_for("ply\n" + std::string(100000, 'x')), "no end within 65536 bytes"));
  write_rig(folder.path);
  const Scene scene = read_scene(folder.path);
  write_text(folder.path / "lidar/0.ply", replaced(ascii_ply(), "float y", "float why"));
  CHECK(holds(error_of([&] { load_sweep(scene, scene.sweeps[0]); }), "no property y; they have x, why, z, intensity"));
  write_text(folder.path / "lidar/1.npy", replaced(npy(), "(2, 4)", "(4, 2)"));
  CHECK(holds(error_of([&] { load_sweep(scene, scene.sweeps[1]); }), "looked for an array of shape [N, 3]"));
}
