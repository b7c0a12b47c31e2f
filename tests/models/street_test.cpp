// Made streets: what the truth says agrees with the geometry that is written beside it.
#include <doctest/doctest.h>
#include <unistd.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "models/data/check_log.h"
#include "models/data/load_sweep.h"
#include "models/data/read_scene.h"
#include "models/io/image.h"
#include "models/synth/box_tree.h"
#include "models/synth/procedural.h"
#include "models/synth/street_log.h"
#include "models/synth/street_sensors.h"
#include "models/synth/street_vehicles.h"
#include "runtime/error.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;
using Eigen::Matrix4d;
using Eigen::Vector3d;

namespace {

constexpr int kFrames = 3, kWidth = 128, kHeight = 72;

StreetLogOptions small_options() {
  StreetLogOptions options;
  options.frames = kFrames;
  options.width = kWidth;
  options.height = kHeight;
  options.seed = 11;
  return options;
}

/// Two cameras by day, written once for all cases that read it.
const fs::path& small_log() {
  static const Folder folder;
  static const fs::path log = [] {
    write_street_log(folder.path / "001", small_options());
    return folder.path / "001";
  }();
  return log;
}

std::string number(int step) { return "0" + std::to_string(step); }

Image actors_of(const fs::path& log, const std::string& camera, int step) {
  return read_image(log / "truth" / camera / (number(step) + "_actor.png"));
}

/// float16 as numpy saves it, decoded here anew.
std::vector<double> depth_of(const fs::path& log, const std::string& camera, int step) {
  const std::string bytes = content_of(log / "truth" / camera / (number(step) + "_depth.npy"));
  REQUIRE(bytes.size() == 128 + 2 * kWidth * kHeight);
  CHECK(bytes.substr(0, 8) == std::string("\x93NUMPY\x01\x00", 8));
  CHECK(bytes.find("'<f2', 'fortran_order': False, 'shape': (72, 128)") != std::string::npos);
  std::vector<double> depth;
  for (std::size_t i = 128; i < bytes.size(); i += 2) {
    const unsigned bits = static_cast<unsigned char>(bytes[i]) | static_cast<unsigned char>(bytes[i + 1]) << 8;
    const int exponent = static_cast<int>(bits >> 10 & 31);
    const double fraction = (bits & 1023) / 1024.0;
    depth.push_back(exponent == 0 ? std::ldexp(fraction, -14) : std::ldexp(1 + fraction, exponent - 15));
  }
  return depth;
}

/// Where a pixel's centre looks at, by the conventions of the layout.
Vector3d seen_point(const Camera& camera, const Matrix4d& world_from_camera, std::size_t pixel, double depth) {
  const double x = double(pixel % std::size_t(camera.width)) + 0.5, y = double(pixel / std::size_t(camera.width)) + 0.5;
  const Vector3d seen((x - camera.cx) / camera.fx * depth, (y - camera.cy) / camera.fy * depth, depth);
  return (world_from_camera * seen.homogeneous()).head<3>();
}

/// How far a point is outside a box; negative inside.
double outside(const Matrix4d& world_from_box, const Vector3d& size, const Vector3d& point) {
  const Vector3d local = (world_from_box.inverse() * point.homogeneous()).head<3>();
  return (local.cwiseAbs() - 0.5 * size).maxCoeff();
}

const ActorBox* box_at(const Actor& actor, int step) {
  for (const ActorBox& box : actor.boxes) {
    if (box.step == step) return &box;
  }
  return nullptr;
}

Exposure exposure_of(double turn) {
  Exposure exposure;
  exposure.mount = &mount_of("front_camera");
  exposure.camera.width = 96;
  exposure.camera.height = 54;
  exposure.camera.fx = exposure.camera.fy = exposure.mount->focal * 96;
  exposure.camera.cx = 48;
  exposure.camera.cy = 27;
  exposure.turn = turn;
  return exposure;
}

}  // namespace

TEST_CASE("street logs: the reader takes them, the check finds nothing odd, and there is traffic") {
  const Scene log = read_scene(small_log());
  CHECK(log.format == "PandaSet");
  CHECK(log.warnings.empty());
  CHECK_FALSE(log.night);
  CHECK(log.frames.size() == 2 * kFrames);
  const LogReport report = check_log(log);
  CHECK(report.warnings.empty());
  CHECK(report.rate == doctest::Approx(10));
  CHECK(report.points_per_sweep > 10000);
  REQUIRE(report.fits.size() == 2);
  for (const LidarFit& fit : report.fits) {
    CAPTURE(fit.sensor);
    CHECK(fit.share_worse > 0.95);
    CHECK(std::max(std::abs(fit.offset_x), std::abs(fit.offset_y)) <= 1);
  }
  int parked = 0, with = 0, against = 0;
  std::set<std::string> labels;
  for (const Actor& actor : log.actors) {
    labels.insert(actor.label);
    parked += actor.stationary;
    const Vector3d way = (actor.boxes.back().world_from_box - actor.boxes.front().world_from_box).col(3).head<3>();
    if (actor.stationary) CHECK(way.norm() < 1e-9);
    if (actor.stationary || actor.boxes.size() < 2) continue;
    // What moves goes where it looks.
    CHECK(way.normalized().dot(actor.boxes[0].world_from_box.col(1).head<3>()) > 0.99);
    (way.y() > 0 ? with : against)++;
  }
  CHECK(log.actors.size() >= 10);
  CHECK(labels.size() >= 4);
  CHECK(parked >= 4);
  CHECK(with >= 2);
  CHECK(against >= 2);
}

TEST_CASE("street logs: what a mask calls an actor lies in its box, and nothing else does") {
  const Scene log = read_scene(small_log());
  const auto names = nlohmann::json::parse(content_of(small_log() / "truth/actors.json"));
  std::map<std::string, const Actor*> actors;
  for (const Actor& actor : log.actors) actors[actor.id] = &actor;
  int on_actors = 0, outside_boxes = 0, compared = 0, unclaimed = 0;
  for (const Frame& frame : log.frames) {
    const Camera& camera = log.cameras[std::size_t(frame.camera)];
    const Image mask = actors_of(small_log(), frame.sensor, frame.step);
    REQUIRE(mask.channels == 1);
    const auto depth = depth_of(small_log(), frame.sensor, frame.step);
    for (std::size_t pixel = 0; pixel < depth.size(); ++pixel) {
      if (depth[pixel] == 0) CHECK(mask.pixels[pixel] == 0);
      if (depth[pixel] == 0) continue;
      const Vector3d point = seen_point(camera, frame.world_from_camera, pixel, depth[pixel]);
      const double grain = 0.01 + depth[pixel] / 1000;  // of float16
      if (mask.pixels[pixel] != 0) {
        const auto found = actors.find(names.at(std::to_string(mask.pixels[pixel])).get<std::string>());
        const ActorBox* box = found == actors.end() ? nullptr : box_at(*found->second, frame.step);
        if (!box) CHECK((point - frame.world_from_camera.col(3).head<3>()).norm() > 70);
        if (!box) continue;
        ++on_actors;
        outside_boxes += outside(box->world_from_box, found->second->size, point) > grain;
      } else {
        for (const Actor& actor : log.actors) {
          const ActorBox* box = box_at(actor, frame.step);
          if (!box) continue;
          ++compared;
          unclaimed += outside(box->world_from_box, actor.size, point) < -grain;
        }
      }
    }
  }
  CHECK(on_actors > 2000);
  CHECK(outside_boxes == 0);
  CHECK(compared > 10000);
  CHECK(unclaimed == 0);
}

TEST_CASE("street logs: LiDAR points lie at the depth that the pictures have") {
  const Scene log = read_scene(small_log());
  const Frame& frame = log.frames[1];
  const Camera& camera = log.cameras[std::size_t(frame.camera)];
  const auto depth = depth_of(small_log(), frame.sensor, frame.step);
  const LidarPoints points = load_sweep(log, log.sweeps[std::size_t(frame.step)]);
  const Matrix4d lidar_from_world = log.sweeps[std::size_t(frame.step)].world_from_lidar.inverse();
  int compared = 0, agreed = 0, untimely = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    CHECK(std::abs(points.times[i]) <= 0.05f);
    const Eigen::Vector4d world(points.positions[3 * i], points.positions[3 * i + 1], points.positions[3 * i + 2], 1);
    const Eigen::Vector4d ahead = lidar_from_world * world;
    untimely += std::abs(points.times[i] + 0.1 / (2 * M_PI) * std::atan2(-ahead.x(), ahead.y())) > 1e-4;
    const Vector3d seen = (frame.world_from_camera.inverse() * world).head<3>();
    if (seen.z() < 1) continue;
    const Eigen::Vector2d place = project(camera, seen);
    if (place.x() < 0 || place.y() < 0 || place.x() >= camera.width || place.y() >= camera.height) continue;
    const double there = depth[std::size_t(place.y()) * kWidth + std::size_t(place.x())];
    ++compared;
    agreed += std::abs(there - seen.z()) < 0.1 + 0.02 * seen.z();
  }
  CHECK(untimely == 0);  // the beam turns clockwise from the rear
  CHECK(compared > 500);
  CHECK(agreed > 0.85 * compared);  // LiDAR and camera are 1 m apart and see other edges
}

TEST_CASE("street logs: turned actors lie in their turned boxes, and their shadows follow") {
  const MadeStreet street = make_street(5, {}, 1);
  const StreetPicture plain = take_picture(street, exposure_of(0));
  for (const double turn : {0.25 * M_PI, 1.5 * M_PI}) {
    const Exposure exposure = exposure_of(turn);
    const StreetPicture turned = take_picture(street, exposure);
    const Matrix4d pose = world_from_camera(street, *exposure.mount, 0);
    int on_actors = 0, shadows = 0;
    for (std::size_t pixel = 0; pixel < turned.depth.size(); ++pixel) {
      const int actor = turned.actor[pixel];
      const bool ground = actor == 0 && plain.actor[pixel] == 0 && turned.depth[pixel] > 0;
      shadows += ground && std::abs(int(turned.image.pixels[3 * pixel]) - int(plain.image.pixels[3 * pixel])) > 20;
      if (actor == 0) continue;
      const StreetActor& made = street.world.actors[std::size_t(actor - 1)];
      Matrix4d box = Matrix4d::Identity();
      const PlacedThing placed = made.at(street.world.course, 0, 0, actor);
      box.topLeftCorner<3, 3>() = turn_about_z(std::atan2(placed.turn.y(), placed.turn.x()) + turn);
      box.col(3).head<3>() = placed.position + Vector3d(0, 0, 0.5 * made.thing->bounds.sizes().z());
      const Vector3d point = seen_point(exposure.camera, pose, pixel, turned.depth[pixel]);
      CHECK(outside(box, made.thing->bounds.sizes(), point) < 1e-3);
      ++on_actors;
    }
    CHECK(on_actors > 200);
    CHECK(shadows > 10);
  }
  const StreetPicture around = take_picture(street, exposure_of(2 * M_PI));
  int other = 0;
  for (std::size_t i = 0; i < around.image.pixels.size(); ++i) other += around.image.pixels[i] != plain.image.pixels[i];
  CHECK(other < 30);  // rounding at edges
}

TEST_CASE("street logs: under clouds actors stand where they stood, and cast no shadows") {
  const Exposure exposure = exposure_of(0);
  const auto shadows = [&](double clouds) {
    const MadeStreet street = make_street(5, {false, clouds}, 1);
    const Matrix4d pose = world_from_camera(street, *exposure.mount, 0);
    const StreetPicture picture = take_picture(street, exposure);
    const StreetMoment before(street.world, 0), after(street.world, 0, 0.5 * M_PI);
    const auto covered = [&](const Vector3d& point) {  // dark under any sky
      const Ray up{point + Vector3d(0, 0, 0.01), Vector3d::UnitZ()};
      return before.nearest(up, 0) || after.nearest(up, 0);
    };
    int count = 0;
    for (std::size_t pixel = 0; pixel < picture.depth.size(); ++pixel) {
      if (picture.depth[pixel] == 0) continue;
      const Vector3d place = pose.topRightCorner<3, 1>(),
                     point = seen_point(exposure.camera, pose, pixel, picture.depth[pixel]);
      const Ray ray{place, (point - place).normalized()};
      const auto a = before.nearest(ray, 0), b = after.nearest(ray, 0);
      if (!a || !b || a->actor != 0 || b->actor != 0 || covered(point)) continue;
      count += (before.colour(ray, 0) - after.colour(ray, 0)).norm() > 0.1;
    }
    return count;
  };
  CHECK(shadows(0) > 20);
  CHECK(shadows(1) == 0);
  const auto actors_under = [&](double clouds) {
    return take_picture(make_street(5, {false, clouds}, 1), exposure).actor;
  };
  CHECK(actors_under(1) == actors_under(0));
}

TEST_CASE("street logs: the turned frames on disk are those of their angle") {
  const MadeStreet street = make_street(small_options().seed, {}, 0.1 * kFrames);
  Exposure exposure = exposure_of(0);
  exposure.camera = {kWidth,
                     kHeight,
                     exposure.mount->focal * kWidth,
                     exposure.mount->focal * kWidth,
                     0.5 * kWidth,
                     0.5 * kHeight,
                     CameraModel::pinhole,
                     {},
                     0,
                     0};
  CHECK(take_picture(street, exposure).actor == actors_of(small_log(), "front_camera", 0).pixels);
  for (const int degrees : {90, 315}) {
    exposure.turn = degrees * M_PI / 180;
    exposure.time = 0.1;
    const fs::path folder = small_log() / "truth" / ("rot" + std::to_string(1000 + degrees).substr(1)) / "front_camera";
    const StreetPicture picture = take_picture(street, exposure);
    CHECK(picture.actor == read_image(folder / "01_actor.png").pixels);
    const Image written = read_image(folder / "01.jpg");
    double error = 0;
    for (std::size_t i = 0; i < written.pixels.size(); ++i) {
      error += std::abs(int(written.pixels[i]) - int(picture.image.pixels[i]));
    }
    CHECK(error / double(written.pixels.size()) < 3);
  }
}

TEST_CASE("street logs: a rolling shutter's rows and a moving LiDAR's columns are those of their times") {
  const MadeStreet street = make_street(6, {}, 1);
  Exposure exposure = exposure_of(0);
  exposure.time = 0.3;
  exposure.duration = 0.2;
  const StreetPicture rolling = take_picture(street, exposure);
  const std::size_t width = 96, height = 54;
  for (const std::size_t row : {std::size_t(20), height - 1}) {
    Exposure instant = exposure;
    instant.duration = 0;
    const auto difference = [&] {
      const StreetPicture still = take_picture(street, instant);
      double sum = 0;
      for (std::size_t x = width * row; x < width * (row + 1); ++x) sum += std::abs(still.depth[x] - rolling.depth[x]);
      return sum;
    };
    if (row == 20) CHECK(difference() > 0.1);
    instant.time = 0.3 + 0.2 * ((double(row) + 0.5) / double(height) - 0.5);
    CHECK(difference() < 1e-6);
  }
  Spin spin;
  spin.time = 0.3;
  spin.columns = 40;
  spin.moving = true;
  const LidarPoints moving = take_sweep(street, spin);
  const float first = moving.times.front();
  CHECK(first == doctest::Approx(0.1 * (0.5 / 40 - 0.5)));
  spin.time = 0.3 + first;
  spin.moving = false;
  const LidarPoints still = take_sweep(street, spin);
  for (std::size_t i = 0; i < 3 && moving.times[i] == first; ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      CHECK(moving.positions[3 * i + axis] == doctest::Approx(still.positions[3 * i + axis]).epsilon(1e-6));
    }
  }
}

TEST_CASE("street logs: equal options give equal bytes, another seed another street") {
  StreetLogOptions options = small_options();
  options.frames = 1;
  options.width = 32;
  options.height = 18;
  const Folder a, b, c;
  write_street_log(a.path, options);
  write_street_log(b.path, options);
  options.seed = 12;
  options.night = true;
  write_street_log(c.path, options);
  std::size_t files = 0, different = 0;
  for (const auto& entry : fs::recursive_directory_iterator(a.path)) {
    if (!entry.is_regular_file()) continue;
    const fs::path name = fs::relative(entry.path(), a.path);
    CAPTURE(name.string());
    ++files;
    CHECK(content_of(entry.path()) == content_of(b.path / name));
    different += content_of(entry.path()) != content_of(c.path / name);
  }
  CHECK(files >= 29);
  CHECK(different >= 22);
  CHECK(read_scene(c.path).night);
  options.cameras = {"side_camera"};
  CHECK_THROWS_AS(write_street_log(c.path, options), Error);
  options = small_options();
  options.frames = 0;
  CHECK_THROWS_AS(write_street_log(c.path, options), Error);
}

TEST_CASE("street logs: half the rate is every second step of the same street") {
  StreetLogOptions options = small_options();
  options.frames = 4;
  options.truth = false;
  const Folder all, half;
  write_street_log(all.path, options);
  options.frames = 2;
  options.rate = 5;
  write_street_log(half.path, options);
  for (const std::string camera : {"front_camera", "front_left_camera"}) {
    CHECK(content_of(half.path / "camera" / camera / "01.jpg") == content_of(all.path / "camera" / camera / "02.jpg"));
    CHECK(content_of(half.path / "camera" / camera / "01.jpg") != content_of(all.path / "camera" / camera / "01.jpg"));
  }
  const Scene a = read_scene(all.path), b = read_scene(half.path);
  CHECK(b.sweeps[1].timestamp == a.sweeps[2].timestamp);
  CHECK(b.sweeps[1].world_from_lidar.isApprox(a.sweeps[2].world_from_lidar));
  options.frames = 101;
  CHECK_THROWS_AS(write_street_log(half.path, options), Error);
  options.frames = 2;
  options.rate = 0;
  CHECK_THROWS_AS(write_street_log(half.path, options), Error);
}

TEST_CASE("street logs: nights come in the proportion that was asked for, in another order for another seed") {
  std::set<std::string> orders;
  for (const std::uint64_t seed : {1, 2, 3, 4, 5, 6}) {
    std::string order;
    for (int log = 0; log < 40; ++log) order += street_log_night(seed, log, 0.25) ? 'n' : 'd';
    CHECK(std::count(order.begin(), order.end(), 'n') == 10);
    orders.insert(order);
    CHECK_FALSE(street_log_night(seed, 0, 0));
    CHECK(street_log_night(seed, 7, 1));
  }
  CHECK(orders.size() >= 2);
}

TEST_CASE("street logs: pandas reads their pickles") {
  if (std::system("/usr/bin/python3 -c 'import pandas' >/dev/null 2>&1") != 0) {
    MESSAGE("skipped: no pandas (apt-get install python3-pandas)");
    return;
  }
  const std::string program = "cd '" + small_log().string() + R"(' && /usr/bin/python3 -c "
import glob
import pandas as pd
for name in sorted(glob.glob('lidar/*.pkl.gz')):
    sweep = pd.read_pickle(name)
    assert list(sweep.columns) == list('xyzitd') and len(sweep) > 10000 and sweep.i.max() <= 255, name
for name in sorted(glob.glob('annotations/cuboids/*.pkl.gz')):
    boxes = pd.read_pickle(name)
    assert len(boxes) >= 10 and boxes.uuid.is_unique and (boxes['dimensions.x'] > 0.1).all(), name
")";
  CHECK(std::system(program.c_str()) == 0);
}

TEST_CASE("road users: white light in front, red behind, and wheels on the ground") {
  HostRandom random(3);
  for (const RoadUser kind : {RoadUser::car, RoadUser::pickup, RoadUser::truck, RoadUser::semi, RoadUser::bus,
                              RoadUser::emergency, RoadUser::motorcycle, RoadUser::scooter, RoadUser::bicycle}) {
    const RoadUserAppearance appearance = make_road_user(kind, random);
    CAPTURE(appearance.label);
    const Eigen::AlignedBox3d& box = appearance.thing->bounds;
    CHECK(std::abs(box.min().z()) < 1e-5);
    CHECK(box.sizes().y() > 1.3 * box.sizes().x());
    const ThingSet things({{appearance.thing, appearance.thing->pivot(), {1, 0}}});
    int white[2] = {0, 0}, red[2] = {0, 0};
    for (double x = box.min().x(); x < box.max().x(); x += 0.03) {
      for (double z = 0.3; z < 1.4; z += 0.03) {
        for (const int behind : {0, 1}) {
          const Ray ray{{x, behind ? -50.0 : 50.0, z}, {0, behind ? 1.0 : -1.0, 0}};
          const auto hit = things.nearest(ray, 100);
          if (!hit) continue;
          const Vector3d glow =
              hit->part
                  ->material({ray.origin + hit->ray.distance * ray.direction, hit->ray.normal, ray.direction, 0.01})
                  .glow;
          white[behind] += glow.minCoeff() > 0.5;
          red[behind] += glow.x() > 0.4 && glow.y() < 0.1;
        }
      }
    }
    CHECK(white[0] > 0);
    CHECK(white[1] == 0);
    CHECK(red[0] == 0);
    CHECK(red[1] > 0);
  }
}

TEST_CASE("a course and its coordinates undo each other, straight and bent to either side") {
  for (const double curvature : {0.0, 1e-7, 1 / 150.0, -1 / 150.0}) {
    const Course course{curvature};
    for (const double along : {-60.0, 0.0, 140.0}) {
      for (const double right : {-14.0, 0.0, 9.0}) {
        const Eigen::Vector2d back = course.coordinates(course.place(along, right));
        CHECK(back.x() == doctest::Approx(along).epsilon(1e-6));
        CHECK(back.y() == doctest::Approx(right).epsilon(1e-6));
      }
    }
    // The street looks where its yaw says.
    const Eigen::Vector2d step = (course.place(50.001, 0) - course.place(49.999, 0)).normalized();
    CHECK(step.x() == doctest::Approx(-std::sin(course.yaw(50))).epsilon(1e-4));
    CHECK(course.place(50, 1).x() > course.place(50, 0).x());
  }
}

TEST_CASE("rays: the tree of boxes finds what a search through all of them finds") {
  HostRandom random(4);
  const auto point = [&](double reach) {
    return Vector3d(random.between(-reach, reach), random.between(-reach, reach), random.between(-reach, reach));
  };
  std::vector<Eigen::AlignedBox3d> boxes;
  for (int i = 0; i < 60; ++i) {
    const Vector3d centre = point(10), half = point(3).cwiseAbs();
    boxes.push_back({Vector3d(centre - half), Vector3d(centre + half)});
  }
  const BoxTree tree(boxes);
  int hits = 0;
  for (int i = 0; i < 300; ++i) {
    const Ray ray{point(12), point(1).normalized()};
    std::set<std::size_t> found, wanted;
    tree.along(ray, 15.0, [&](std::size_t index) { found.insert(index); });
    for (std::size_t b = 0; b < boxes.size(); ++b) {
      const auto solid = make_placed(make_box(0.5 * boxes[b].sizes()), boxes[b].center(), Eigen::Matrix3d::Identity());
      const auto hit = solid->hit(ray, 0);
      if (hit && hit->distance < 15 && !boxes[b].contains(ray.origin)) wanted.insert(b);
    }
    for (const std::size_t index : wanted) CHECK(found.contains(index));
    CHECK(found.size() <= wanted.size() + 6);  // those that the ray starts in
    hits += static_cast<int>(wanted.size());
  }
  CHECK(hits > 100);
}

TEST_CASE("rays: a tapered block is met on its slanted faces, and missed beside them") {
  TaperedShape shape;
  shape.bottom = {Eigen::Vector2d(-1, -2), Eigen::Vector2d(1, 2)};
  shape.top = {Eigen::Vector2d(-0.5, -1), Eigen::Vector2d(0.5, 2)};
  shape.high = 2;
  const auto block = make_tapered(shape);
  CHECK(block->bounds().sizes() == Vector3d(2, 4, 2));
  const auto side = block->hit({{5, 0, 1}, {-1, 0, 0}}, 0);
  REQUIRE(side);
  CHECK(side->distance == doctest::Approx(4.25));  // half way up the half width is 0.75
  CHECK((side->normal - Vector3d(2, 0, 0.5).normalized()).norm() < 1e-12);
  const auto rear = block->hit({{0, -5, 1}, {0, 1, 0}}, 0);
  REQUIRE(rear);
  CHECK(rear->distance == doctest::Approx(3.5));
  CHECK(block->hit({{0, 5, 1}, {0, -1, 0}}, 0)->normal == Vector3d(0, 1, 0));
  CHECK_FALSE(block->hit({{0.8, -5, 1.9}, {0, 1, 0}}, 0));
  CHECK_FALSE(block->hit({{0, 0, 2.1}, {0, 1, 0}}, 0));
  // Turned by 90 degrees and moved: what was its side is its front.
  const auto placed = make_placed(make_tapered(shape), {10, 0, 0}, turn_about_z(0.5 * M_PI));
  const auto front = placed->hit({{10, 5, 1}, {0, -1, 0}}, 0);
  REQUIRE(front);
  CHECK(front->distance == doctest::Approx(4.25));
  CHECK((front->normal - Vector3d(0, 2, 0.5).normalized()).norm() < 1e-12);
  CHECK(placed->bounds().contains(Vector3d(11.9, 0.9, 0.1)));
}
