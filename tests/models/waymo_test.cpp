// Waymo's drives as plain files: a small one written by Python with nothing but its own library, and what is broken in
// it.
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <nlohmann/json.hpp>

#include "models/data/load_images.h"
#include "models/data/load_sweep.h"
#include "models/data/read_scene.h"
#include "models/io/json.h"
#include "models/runs/recorded_log.h"
#include "models/scene/asset_class.h"
#include "models/scene/split.h"
#include "tests/models/errors.h"
#include "tests/models/told.h"
#include "tests/models/written_by_python.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

// The car drives along a bend, three frames; two cameras, one of them with Waymo's axes (x forward, y left, z up) and
// lens terms, a LiDAR on the roof and one on the bumper, a car ahead. truth.json has what cloam is to find: landmarks
// from the car's first place, the pixels that they have in each image, the other car.
const char* const kProgram = R"py(
import json, math, os, struct

def turn(angle, p):
    c, s = math.cos(angle), math.sin(angle)
    return [c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]]

def matrix(angle, place):
    c, s = math.cos(angle), math.sin(angle)
    return [[c, -s, 0.0, place[0]], [s, c, 0.0, place[1]], [0.0, 0.0, 1.0, place[2]], [0.0, 0.0, 0.0, 1.0]]

def save(name, rows):  # as numpy.savetxt
    os.makedirs(os.path.dirname(name), exist_ok=True)
    with open(name, "w") as file:
        for row in rows:
            file.write(" ".join("%.18e" % v for v in (row if isinstance(row, list) else [row])) + "\n")

def back(angle, place, p):
    return turn(-angle, [p[i] - place[i] for i in range(3)])

start, cars = [-3411.25, 18320.5, 12.0], []
for step in range(3):
    angle = 0.4 + 0.05 * step
    cars.append((angle, [start[0] + 0.9 * step, start[1] + 0.4 * step, start[2] + 0.01 * step]))
mounts = [(0.0, [1.54, -0.02, 2.11]), (0.78, [1.49, 0.09, 2.11])]
lenses = [[200.5, 201.5, 82.0, 49.0, 0.05, -0.02, 0.001, -0.002, 0.004], [199.0, 199.0, 80.0, 45.0, 0.0, 0.0, 0.0, 0.0, 0.0]]
roof, bumper = [1.43, 0.0, 2.18], [4.07, 0.0, 0.69]
landmarks = [turn(0.4, [12 + i, 2 * i - 8, 0.3 * i]) for i in range(10)]
landmarks = [[start[k] + p[k] for k in range(3)] for p in landmarks]
truth = {"landmarks": [[p[k] - start[k] for k in range(3)] for p in landmarks], "pixels": {}, "car": []}
for camera, ((angle, place), lens) in enumerate(zip(mounts, lenses)):
    pose = matrix(angle, place)
    if camera == 1:  # in OpenCV's axes: x right, y down, z forward
        pose = [[-row[1], -row[2], row[0], row[3]] for row in pose]
    save("extrinsics/%d.txt" % camera, pose)
    save("intrinsics/%d.txt" % camera, lens)
boxes = {"frame_idx": [], "obj_to_world": [], "box_size": []}
for step, (angle, place) in enumerate(cars):
    save("ego_pose/%03d.txt" % step, matrix(angle, place))
    seen = [back(angle, place, p) for p in landmarks]
    os.makedirs("lidar", exist_ok=True)
    with open("lidar/%03d.bin" % step, "wb") as file:
        for i, p in enumerate(seen):
            file.write(struct.pack("<14f", *roof, *p, 0, 0, 0, -1, 0, 0.05 * i, 0.5, 0))
            file.write(struct.pack("<14f", *bumper, p[0], p[1], p[2] + 1, 0, 0, 0, -1, 0, 0.9, 0.5, 1))
    for camera, ((turned, at), (fx, fy, cx, cy, k1, k2, p1, p2, k3)) in enumerate(zip(mounts, lenses)):
        pixels = []
        for p in seen:
            x, y, z = back(turned, at, p)
            if x < 2:
                pixels.append([])
                continue
            a, b = -y / x, -z / x
            r = a * a + b * b
            gain = 1 + k1 * r + k2 * r * r + k3 * r ** 3
            u = a * gain + 2 * p1 * a * b + p2 * (r + 2 * a * a)
            v = b * gain + p1 * (r + 2 * b * b) + 2 * p2 * a * b
            pixels.append([fx * u + cx, fy * v + cy])
        truth["pixels"]["images/%03d_%d.jpg" % (step, camera)] = pixels
    other = [start[k] + turn(0.4, [15 + 1.1 * step, 1, 0.8])[k] for k in range(3)]
    boxes["frame_idx"].append(step)
    boxes["obj_to_world"].append(matrix(0.45, other))
    boxes["box_size"].append([4.5, 1.9, 1.6])
    truth["car"].append({"place": [other[k] - start[k] for k in range(3)], "ahead": turn(0.45, [1, 0, 0])})
os.makedirs("instances", exist_ok=True)
with open("instances/instances_info.json", "w") as file:
    json.dump({"0": {"id": "Kx_7", "class_name": "Vehicle", "frame_annotations": boxes}}, file)
with open("frame_info.json", "w") as file:
    json.dump({"time_of_day": "Night", "location": "location_sf", "weather": "sunny", "TYPE_VEHICLE": 1}, file)
with open("truth.json", "w") as file:
    json.dump(truth, file)
)py";

struct Drive : WrittenByPython {
  Drive() : WrittenByPython(kProgram) {}
  /// Of the drive once that file has other content.
  std::string error_with(const char* file, const std::string& content) const {
    const std::string before = content_of(root / file);
    write_text(root / file, content);
    const std::string error = error_of([&] {
      const Scene scene = read_scene(root);
      for (const Sweep& sweep : scene.sweeps) (void)load_sweep(scene, sweep);
    });
    write_text(root / file, before);
    return error;
  }
};

}  // namespace

TEST_CASE("Waymo: images, points and boxes lie where the drive's files put them") {
  if (no_python()) return;
  const Drive drive;
  REQUIRE(drive.made);
  const Json truth = drive.truth();
  const Scene scene = read_scene(drive.root);
  CHECK(scene.format == "Waymo");
  CHECK((scene.is_log && scene.metric && scene.night));
  CHECK(scene.warnings.empty());
  CHECK(front_sensor(scene) == "front_camera");
  REQUIRE(scene.sweeps.size() == 3);
  for (const Sweep& sweep : scene.sweeps) {
    const LidarPoints points = load_sweep(scene, sweep);
    REQUIRE(points.size() == truth.at("landmarks").size());  // the roof's alone
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d found(points.positions[3 * i], points.positions[3 * i + 1], points.positions[3 * i + 2]);
      CHECK((found - vector_of(truth.at("landmarks")[i])).norm() < 1e-3);
      CHECK(points.intensities[i] == doctest::Approx(0.05 * double(i)));
    }
  }
  // The LiDAR stands on the roof: 2.18 m above the car's first place.
  const Eigen::Vector3d roof = scene.sweeps[0].world_from_lidar.topRightCorner<3, 1>();
  CHECK((roof - Eigen::Vector3d(1.43 * std::cos(0.4), 1.43 * std::sin(0.4), 2.18)).norm() < 1e-5);
  REQUIRE(scene.frames.size() == 6);
  int seen = 0;
  for (const Frame& frame : scene.frames) {
    const Json& pixels = truth.at("pixels").at(frame.image);
    CHECK(*frame.timestamp == doctest::Approx(0.1 * frame.step));
    seen += check_landmarks(scene, frame, truth.at("landmarks"), pixels);
  }
  CHECK(seen > 40);
  // Our boxes look along +y, and their x points right.
  REQUIRE(scene.actors.size() == 1);
  const Actor& car = scene.actors[0];
  CHECK((car.id == "Kx_7" && car.label == "Vehicle" && asset_class(car.label) == 0));
  CHECK(car.size == Eigen::Vector3d(1.9, 4.5, 1.6));
  REQUIRE(car.boxes.size() == 3);
  for (const ActorBox& box : car.boxes) {
    const Json& there = truth.at("car")[static_cast<std::size_t>(box.step)];
    CHECK((box.world_from_box.topRightCorner<3, 1>() - vector_of(there.at("place"))).norm() < 1e-5);
    CHECK((box.world_from_box.col(1).head<3>() - vector_of(there.at("ahead"))).norm() < 1e-6);
    CHECK(box.world_from_box(2, 2) == doctest::Approx(1));
  }
}

TEST_CASE("Waymo: with other cameras and boxes a drive is written in PandaSet's layout, its photos straight") {
  if (no_python()) return;
  const Drive drive;
  REQUIRE(drive.made);
  Scene wanted = read_scene(drive.root);
  wanted.frames[1].world_from_camera.topRightCorner<3, 1>() += Eigen::Vector3d(0.1, 0.2, -0.3);
  for (Camera& camera : wanted.cameras) camera = with_lens(camera, {1.05, {0, 0}});
  wanted.actors[0].boxes[2].world_from_box.topRightCorner<3, 1>() += Eigen::Vector3d(0.5, 0, 0);
  // Photos that show a known function of the direction.
  const auto red = [](const Eigen::Vector3d& towards) { return 128 + 60 * std::sin(8 * towards.x() / towards.z()); };
  const auto green = [](const Eigen::Vector3d& towards) { return 128 + 60 * std::cos(9 * towards.y() / towards.z()); };
  for (const Frame& frame : wanted.frames) {
    const Camera& lens = wanted.cameras[static_cast<std::size_t>(frame.camera)];
    Image photo{lens.width, lens.height, 3, {}};
    for (int i = 0; i < lens.width * lens.height; ++i) {
      const Eigen::Vector3d towards = direction(lens, {i % lens.width + 0.5, i / lens.width + 0.5});
      for (const double value : {red(towards), green(towards), 90.0})
        photo.pixels.push_back(static_cast<std::uint8_t>(std::lround(value)));
    }
    write_jpeg(drive.root / frame.image, photo);
  }
  Told told;
  write_recorded_log(drive.root / "written", wanted, false, told.listener());
  CHECK(told.warned.empty());

  const Scene again = read_scene(drive.root / "written");
  CHECK(again.format == "PandaSet");
  CHECK(again.night);
  CHECK(again.warnings.empty());
  REQUIRE(again.frames.size() == 6);
  REQUIRE(again.sweeps.size() == 3);
  for (std::size_t i = 0; i < 6; ++i) {
    const Frame &is = again.frames[i], &was = wanted.frames[i];
    CHECK((is.sensor == was.sensor && is.step == was.step));
    CHECK((is.world_from_camera - was.world_from_camera).norm() < 1e-9);
    const Camera& pinhole = again.cameras[static_cast<std::size_t>(is.camera)];
    CHECK(pinhole.model == CameraModel::pinhole);
    CHECK(pinhole.fx == doctest::Approx(wanted.cameras[static_cast<std::size_t>(was.camera)].fx));
    const Image photo = photo_of(again, is);
    double worst = 0;
    for (int p = 0; p < photo.width * photo.height; ++p) {
      const Eigen::Vector3d towards = direction(pinhole, {p % photo.width + 0.5, p / photo.width + 0.5});
      worst = std::max({worst, std::abs(photo.pixels[std::size_t(3 * p)] - red(towards)),
                        std::abs(photo.pixels[std::size_t(3 * p + 1)] - green(towards))});
    }
    CHECK(worst < 12);  // two times JPEG
  }
  for (std::size_t i = 0; i < 3; ++i) {
    const LidarPoints a = load_sweep(again, again.sweeps[i]), b = load_sweep(wanted, wanted.sweeps[i]);
    REQUIRE(a.size() == b.size());
    for (std::size_t k = 0; k < a.positions.size(); ++k) CHECK(std::abs(a.positions[k] - b.positions[k]) < 1e-5);
    CHECK((again.sweeps[i].world_from_lidar - wanted.sweeps[i].world_from_lidar).norm() < 1e-9);
  }
  REQUIRE(again.actors.size() == 1);
  CHECK(again.actors[0].id == "Kx_7");
  for (std::size_t b = 0; b < 3; ++b)
    CHECK((again.actors[0].boxes[b].world_from_box - wanted.actors[0].boxes[b].world_from_box).norm() < 1e-9);
}

TEST_CASE("Waymo: what is missing or damaged is told by its file") {
  if (no_python()) return;
  const Drive drive;
  REQUIRE(drive.made);
  CHECK(holds(drive.error_with("ego_pose/001.txt", "1 0 0 nan"), "ego_pose/001.txt"));
  CHECK(holds(drive.error_with("extrinsics/1.txt", "1 2 3"), "extrinsics/1.txt: looked for 16 numbers, found 3"));
  CHECK(holds(drive.error_with("intrinsics/0.txt", "-5 1 1 1 0 0 0 0 0"), "intrinsics/0.txt"));
  CHECK(holds(drive.error_with("lidar/002.bin", "short"), "lidar/002.bin"));
  const std::string sweep = content_of(drive.root / "lidar/002.bin");
  CHECK(holds(drive.error_with("lidar/002.bin", sweep.substr(0, sweep.size() - 3)), "a multiple of 56"));
  CHECK(holds(drive.error_with("instances/instances_info.json", "{\"0\": {\"id\": \"a\", \"class_name\": \"b\"}}"),
              "instances_info.json, instance 0"));
  CHECK(holds(drive.error_with("instances/instances_info.json",
                               R"({"0": {"id": "a", "class_name": "b", "frame_annotations":
                                   {"frame_idx": [0, 1], "obj_to_world": [], "box_size": []}}})"),
              "has 2 entries of frame_idx, 0 of obj_to_world"));
  const std::string whole = content_of(drive.root / "instances/instances_info.json");
  std::string boxes = whole;
  boxes.replace(boxes.find("[0, 1, 2]"), 9, "[0, 1, 1000000000]");
  write_text(drive.root / "instances/instances_info.json", boxes);
  const Scene longer = read_scene(drive.root);
  CHECK(longer.actors[0].boxes.size() == 2);
  REQUIRE(longer.warnings.size() == 1);
  CHECK(holds(longer.warnings[0], "1 boxes are left out: they are after the last pose of the car"));
  write_text(drive.root / "instances/instances_info.json", whole);
  fs::remove(drive.root / "images/001_0.jpg");
  fs::remove(drive.root / "lidar/000.bin");
  const Scene scene = read_scene(drive.root);
  CHECK(scene.frames.size() == 5);
  CHECK(scene.sweeps.size() == 2);
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "images/001_0.jpg"));
  fs::remove(drive.root / "ego_pose/001.txt");
  fs::remove(drive.root / "extrinsics/1.txt");
  const Scene gaps = read_scene(drive.root);
  CHECK(gaps.frames.size() == 2);
  REQUIRE(gaps.warnings.size() == 1);
  CHECK(holds(gaps.warnings[0], "ego_pose/001.txt, extrinsics/1.txt"));
}
