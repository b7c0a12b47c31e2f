// nuScenes: a small data set in the devkit's schema, written by Python with nothing but its own library, and what is
// broken in it.
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <nlohmann/json.hpp>

#include "models/data/check_log.h"
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

// The car drives along its heading; two cameras (12 a second), a LiDAR (20) and a radar; a truck passes. Landmarks are
// fixed in the world. truth.json has what cloam is to find: landmarks from the car's first place, the pixels that they
// have in each image, the truck at the times of the LiDAR's sweeps.
const char* const kProgram = R"py(
import json, math, os, struct

def mul(a, b):
    w, x, y, z = a; v, i, j, k = b
    return [w*v - x*i - y*j - z*k, w*i + x*v + y*k - z*j, w*j - x*k + y*v + z*i, w*k + x*j - y*i + z*v]

def turn(q, p):
    return mul(mul(q, [0] + list(p)), [q[0], -q[1], -q[2], -q[3]])[1:]

def back(q, t, p):
    return turn([q[0], -q[1], -q[2], -q[3]], [p[i] - t[i] for i in range(3)])

def about_z(angle):
    return [math.cos(angle / 2), 0, 0, math.sin(angle / 2)]

start, heading, began = [411.3, 1180.9, 0.5], 0.3, 1532402927.6
def ego(time):
    way = 5.0 * (time - began)
    return about_z(heading + 0.05 * (time - began)), [start[0] + way * math.cos(heading), start[1] + way * math.sin(heading), start[2]]
def truck(time):
    angle = heading + math.pi / 2
    far = turn(about_z(heading), [14, -6 + 4.0 * (time - began), 1.2])
    return about_z(angle), [start[i] + far[i] for i in range(3)]
landmarks = [[start[0] + 20 * math.cos(0.3 + 0.1 * i) , start[1] + 20 * math.sin(0.3 + 0.1 * i), 0.4 * i] for i in range(-5, 8)]

mounts = {  # translation, rotation; a camera's z looks forward
    "LIDAR_TOP": ([0.94, 0.0, 1.84], about_z(-math.pi / 2)),
    "CAM_FRONT": ([1.70, 0.02, 1.51], [0.5, -0.5, 0.5, -0.5]),
    "CAM_BACK_LEFT": ([1.04, 0.48, 1.56], mul(about_z(1.9), [0.5, -0.5, 0.5, -0.5])),
    "RADAR_FRONT": ([3.4, 0.0, 0.5], [1, 0, 0, 0]),
}
K = [[126.6, 0.0, 81.6], [0.0, 126.6, 49.1], [0.0, 0.0, 1.0]]
rates = {"LIDAR_TOP": 20, "CAM_FRONT": 12, "CAM_BACK_LEFT": 12, "RADAR_FRONT": 13}

tables = {name: [] for name in "scene sample sample_data ego_pose calibrated_sensor sensor sample_annotation instance category".split()}
truth = {"points": {}, "pixels": {}, "truck": [], "landmarks": [[p[i] - start[i] for i in range(3)] for p in landmarks]}
for index, name in enumerate(["scene-0061", "scene-1077"]):
    tables["scene"].append({"token": "s%d" % index, "name": name, "log_token": "l", "nbr_samples": 3, "first_sample_token": "", "last_sample_token": "", "description": ["Parked truck", "Night, big street"][index]})
for channel, (t, q) in mounts.items():
    camera = channel.startswith("CAM")
    tables["sensor"].append({"token": "k" + channel, "channel": channel, "modality": "camera" if camera else "lidar" if channel == "LIDAR_TOP" else "radar"})
    tables["calibrated_sensor"].append({"token": "c" + channel, "sensor_token": "k" + channel, "translation": t, "rotation": q, "camera_intrinsic": K if camera else []})
for scene in range(2):
    for k in range(3):
        tables["sample"].append({"token": "m%d_%d" % (scene, k), "timestamp": round(1e6 * (began + 0.5 * k)), "scene_token": "s%d" % scene, "prev": "", "next": ""})
for channel, rate in rates.items():
    for k in range(rate + 1):
        stamp = round(1e6 * (began + k / rate))
        time, key = 1e-6 * stamp, k % (rate // 2) == 0
        token = "%s%d" % (channel, k)
        ending = {"L": ".pcd.bin", "C": ".jpg", "R": ".pcd"}[channel[0]]
        name = "%s/%s/n008__%s__%d%s" % ("samples" if key else "sweeps", channel, channel, stamp, ending)
        q, t = ego(time)
        tables["ego_pose"].append({"token": "e" + token, "timestamp": stamp, "rotation": q, "translation": t})
        tables["sample_data"].append({"token": token, "sample_token": "m0_%d" % min(2, int(2 * k / rate)), "ego_pose_token": "e" + token, "calibrated_sensor_token": "c" + channel, "filename": name, "fileformat": ending[1:], "width": 160 if channel[0] == "C" else 0, "height": 90 if channel[0] == "C" else 0, "timestamp": stamp, "is_key_frame": key, "prev": "", "next": ""})
        mount, facing = mounts[channel]
        seen = [back(facing, mount, back(q, t, p)) for p in landmarks]
        if channel == "LIDAR_TOP":
            os.makedirs(os.path.dirname(name), exist_ok=True)
            with open(name, "wb") as file:
                for i, p in enumerate(seen):
                    file.write(struct.pack("<5f", *p, 51 + i, i))
            q, t = truck(time)
            ahead = turn(q, [1, 0, 0])
            truth["truck"].append({"place": [t[i] - start[i] for i in range(3)], "ahead": ahead})
        if channel[0] == "C":
            truth["pixels"][name] = [[K[0][0] * p[0] / p[2] + K[0][2], K[1][1] * p[1] / p[2] + K[1][2]] if p[2] > 1 else [] for p in seen]
tables["category"] = [{"token": "g0", "name": "vehicle.truck", "description": ""}, {"token": "g1", "name": "human.pedestrian.adult", "description": ""}]
tables["instance"] = [{"token": "i0", "category_token": "g0"}, {"token": "i1", "category_token": "g1"}]
for k in range(3):
    q, t = truck(began + 0.5 * k)
    tables["sample_annotation"].append({"token": "a%d" % k, "sample_token": "m0_%d" % k, "instance_token": "i0", "translation": t, "size": [2.4, 7.1, 3.0], "rotation": q, "num_lidar_pts": 3})
tables["sample_annotation"].append({"token": "b", "sample_token": "m1_0", "instance_token": "i1", "translation": start, "size": [0.6, 0.7, 1.8], "rotation": [1, 0, 0, 0], "num_lidar_pts": 3})
os.makedirs("v1.0-mini", exist_ok=True)
for name, rows in tables.items():
    with open("v1.0-mini/%s.json" % name, "w") as file:
        json.dump(rows, file, indent=0)
with open("truth.json", "w") as file:
    json.dump(truth, file)
)py";

struct DataSet : WrittenByPython {
  DataSet() : WrittenByPython(kProgram) {}
  fs::path table(const std::string& name) const { return root / "v1.0-mini" / (name + ".json"); }
  Scene read() const { return read_scene(root / "scene-0061"); }
  /// Of the scene, once the first `from` in the table is `to`; the table is restored.
  std::string error_with(const std::string& name, const std::string& from, const std::string& to) const {
    const std::string before = content_of(table(name));
    std::string changed = before;
    const std::size_t at = changed.find(from);
    REQUIRE(at != std::string::npos);
    write_text(table(name), changed.replace(at, from.size(), to));
    const std::string error = error_of([&] { read(); });
    write_text(table(name), before);
    return error;
  }
};

}  // namespace

TEST_CASE("nuScenes: a scene is written in PandaSet's layout, and what it shows lies where the tables put it") {
  if (no_python()) return;
  const DataSet data;
  REQUIRE(data.made);
  const Json truth = data.truth();
  const Scene given = data.read();
  Told told;
  write_recorded_log(data.root / "written", given, false, told.listener());
  CHECK_MESSAGE(holds(told.said, "CAM_FRONT is written as front_camera"), told.said);
  CHECK_MESSAGE(holds(told.said, "CAM_BACK_LEFT is written as left_camera"), told.said);
  const Scene again = read_scene(data.root / "written");
  REQUIRE(again.frames.size() == given.frames.size());
  REQUIRE(again.sweeps.size() == given.sweeps.size());
  int seen = 0;
  for (const Frame& frame : again.frames) {
    // Another order of the cameras: the frame of the same sensor and step.
    const char* sensor = frame.sensor == "front_camera" ? "CAM_FRONT" : "CAM_BACK_LEFT";
    const auto was =
        std::ranges::find_if(given.frames, [&](const Frame& f) { return f.sensor == sensor && f.step == frame.step; });
    REQUIRE(was != given.frames.end());
    CHECK(*frame.timestamp == doctest::Approx(*was->timestamp).epsilon(1e-14));
    const Json& pixels = truth.at("pixels").at(was->image);
    seen += check_landmarks(again, frame, truth.at("landmarks"), pixels);
  }
  CHECK(seen > 40);
  REQUIRE(again.actors.size() == 1);
  CHECK(again.actors[0].label == given.actors[0].label);
  for (const ActorBox& box : again.actors[0].boxes) {
    const Json& there = truth.at("truck")[static_cast<std::size_t>(box.step)];
    CHECK((box.world_from_box.topRightCorner<3, 1>() - vector_of(there.at("place"))).norm() < 1e-3);
  }
}

TEST_CASE("nuScenes: images, points and boxes lie where the tables put them") {
  if (no_python()) return;
  const DataSet data;
  REQUIRE(data.made);
  const Json truth = data.truth();
  const Scene scene = data.read();
  CHECK(scene.format == "nuScenes");
  CHECK((scene.is_log && scene.metric && !scene.night));
  CHECK(scene.warnings.empty());
  REQUIRE(scene.sweeps.size() == 21);
  CHECK(scene.frames.size() == 2 * 13);  // 12 a second: each is nearest to a sweep
  CHECK(front_sensor(scene) == "CAM_FRONT");
  for (const std::string& warning : check_log(scene, false).warnings) CHECK_FALSE(holds(warning, "usually"));
  // Points that the LiDAR saw, in the world, and where images show them.
  for (const Sweep& sweep : scene.sweeps) {
    const LidarPoints points = load_sweep(scene, sweep);
    REQUIRE(points.size() == truth.at("landmarks").size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d found(points.positions[3 * i], points.positions[3 * i + 1], points.positions[3 * i + 2]);
      CHECK((found - vector_of(truth.at("landmarks")[i])).norm() < 1e-4);
      CHECK(points.intensities[i] == doctest::Approx((51 + double(i)) / 255));
    }
  }
  int seen = 0;
  for (const Frame& frame : scene.frames) {
    const Json& pixels = truth.at("pixels").at(frame.image);
    seen += check_landmarks(scene, frame, truth.at("landmarks"), pixels);
    const double off = *frame.timestamp - scene.sweeps[static_cast<std::size_t>(frame.step)].timestamp;
    CHECK(std::abs(off) < 0.0251);
  }
  CHECK(seen > 200);
  // The truck: drawn twice a second, on the way between. Our boxes look along +y, and their x points right.
  REQUIRE(scene.actors.size() == 1);
  const Actor& truck = scene.actors[0];
  CHECK(truck.label == "vehicle.truck");
  CHECK(asset_class(truck.label) == 1);
  CHECK(truck.size == Eigen::Vector3d(2.4, 7.1, 3.0));
  REQUIRE(truck.boxes.size() == 21);
  for (const ActorBox& box : truck.boxes) {
    const Json& there = truth.at("truck")[static_cast<std::size_t>(box.step)];
    CHECK((box.world_from_box.topRightCorner<3, 1>() - vector_of(there.at("place"))).norm() < 1e-5);
    CHECK((box.world_from_box.col(1).head<3>() - vector_of(there.at("ahead"))).norm() < 1e-6);
    CHECK((box.world_from_box.col(2).head<3>() - Eigen::Vector3d::UnitZ()).norm() < 1e-9);
  }
}

TEST_CASE("nuScenes: a scene is named as if it lay in the folder") {
  if (no_python()) return;
  const DataSet data;
  REQUIRE(data.made);
  const std::string several = error_of([&] { read_scene(data.root); });
  CHECK(holds(several, "holds 2 scenes, want one; give one of them as if it were a folder:"));
  CHECK(holds(several, (data.root / "scene-0061").string()));
  CHECK(holds(error_of([&] { read_scene(data.root / "scene-0062"); }),
              "has no scene scene-0062; did you mean scene-0061?"));
  CHECK(holds(error_of([&] { read_scene(data.root / "scene-1077"); }), "sample_data.json: has no row of the scene"));
  CHECK(holds(error_of([&] { read_scene(data.root / "gone" / "scene-0061"); }), "no such folder"));
  const std::string one = content_of(data.table("scene"));
  write_text(data.table("scene"), one.substr(0, one.find("},") + 1) + "]");
  CHECK(read_scene(data.root).part == "scene-0061");
}

TEST_CASE("nuScenes: what is missing or damaged is named") {
  if (no_python()) return;
  const DataSet data;
  REQUIRE(data.made);
  const auto error = [&](const char* table, const char* from, const char* to) {
    return data.error_with(table, from, to);
  };
  CHECK(holds(error("sample_data", "\"eCAM_FRONT3\"", "\"gone\""),
              "ego_pose_token is gone, which v1.0-mini/ego_pose.json has no row for"));
  CHECK(holds(error("sample_data", "\"cLIDAR_TOP\"", "\"gone\""),
              "calibrated_sensor_token is gone, which v1.0-mini/calibrated_sensor.json has no row for"));
  CHECK(holds(error("sample_annotation", "\"i0\"", "\"i7\""),
              "instance_token is i7, which v1.0-mini/instance.json has no row for"));
  CHECK(holds(error("instance", "\"g0\"", "\"g7\""),
              "category_token is g7, which v1.0-mini/category.json has no row for"));
  CHECK(
      holds(error("sensor", "\"modality\"", "\"mode\""), "v1.0-mini/sensor.json, row 0: the key modality is missing"));
  CHECK(holds(error("ego_pose", "\"rotation\": [\n", "\"rotation\": [\n7,\n"),
              "rotation is not a list of 4 finite numbers"));
  CHECK(holds(error("calibrated_sensor", "126.6", "-126.6"), "calibrated_sensor.json, row 1"));
  CHECK(holds(error("sample_annotation", "7.1", "710"), "implausible box size"));
  CHECK(holds(error("sample", "[", "{"), "sample.json"));
  CHECK(holds(error("sample_data", "samples/CAM_FRONT/", "../"), "leaves"));
  const Scene scene = data.read();
  const fs::path sweep = data.root / scene.sweeps[0].file;
  const std::string points = content_of(sweep);
  write_text(sweep, points.substr(0, points.size() - 4));
  CHECK(holds(error_of([&] { load_sweep(scene, scene.sweeps[0]); }),
              "want a multiple of 20 (x y z intensity ring as float32); the file is damaged or truncated"));
  fs::remove(sweep);
  fs::remove(data.root / scene.frames[0].image);
  const Scene rest = data.read();
  CHECK(rest.sweeps.size() == 20);
  REQUIRE(rest.warnings.size() == 1);
  CHECK(holds(rest.warnings[0], "2 listed files are missing and skipped"));
  fs::remove(data.table("ego_pose"));
  CHECK(holds(error_of([&] { data.read(); }), "ego_pose.json is missing; unpack all of the metadata's archive"));
}
