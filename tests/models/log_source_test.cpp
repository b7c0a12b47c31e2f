// What a step gets of a log: pixels and the rays that look through them, returns and where they lie.
#include "models/batches/log_source.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "models/street/street_space.h"
#include "runtime/error.h"
#include "tests/models/toy_street.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

Vector3d origin_of(const RayList& rays, std::size_t r) {
  return Eigen::Map<const Eigen::Vector3f>(&rays.origins[3 * r]).cast<double>();
}
Vector3d direction_of(const RayList& rays, std::size_t r) {
  return Eigen::Map<const Eigen::Vector3f>(&rays.directions[3 * r]).cast<double>();
}
Vector3d moved(const Eigen::Matrix4d& pose, const Vector3d& p) { return (pose * p.homogeneous()).head<3>(); }

/// Does a ray meet a box with room for its mirrors, at a time?
bool meets(const Actor& actor, double time, const Vector3d& origin, const Vector3d& way) {
  const auto pose = world_from_box_at(actor, time);
  if (!pose) return false;
  const Vector3d o = moved(pose->inverse(), origin), d = pose->inverse().topLeftCorner<3, 3>() * way,
                 half = actor.size / 2 + Vector3d(0.125, 0.125, 0.05);
  const Eigen::Array3d a = (-half - o).array() / d.array(), b = (half - o).array() / d.array();
  return std::max(0., a.min(b).maxCoeff()) < a.max(b).minCoeff();
}

}  // namespace

TEST_CASE("patches: rays look through the middle of the pixels that they stand for") {
  const Folder folder;
  const Scene scene = toy_street(folder.path, {.frames = 3});
  const StreetSpace space(scene, {});
  for (const int scale : {1, 2, 4}) {
    CAPTURE(scale);
    const LogSource data(scene, toy_pixels(scene), {}, {space.street_from_world(), scale});
    CHECK(data.patch_side(100) == 24 / scale);
    CHECK(data.patch_side(3) == 3);
    HostRandom random(1, 2);
    RayList rays;
    const int64_t count = 6, side = 5, pixels = side * scale;
    const Tensor image = data.add_patches(rays, random, count, side, {}).truth;
    CHECK(image.shape() == Shape{count, 3, pixels, pixels});
    const std::vector<float> truth = image.to_host();
    REQUIRE(rays.count() == count * side * side);
    REQUIRE(rays.times.size() == std::size_t(count));
    for (int64_t n = 0; n < count; ++n)
      for (int64_t y = 0; y < side; ++y)
        for (int64_t x = 0; x < side; ++x) {
          const auto value = [&](int64_t channel) {
            const int64_t at = ((n * 3 + channel) * pixels + y * scale) * pixels + x * scale;
            return static_cast<int>(std::lround(255 * truth[static_cast<std::size_t>(at)]));
          };
          // The photos' colours tell where a pixel is and of which photo.
          const int column = value(0) / 7, row = value(1) / 9;
          const auto frame = static_cast<std::size_t>((value(2) + 512 - 3 * column - 5 * row) % 256 / 40);
          REQUIRE(frame < 3);
          const auto r = static_cast<std::size_t>((n * side + y) * side + x);
          CHECK(rays.moments[r] == static_cast<int>(n));
          CHECK(rays.times[std::size_t(n)] == 0.1 * static_cast<double>(frame));
          CHECK(rays.ranges[r] == 0);
          const Eigen::Matrix4d pose = space.street_from_world() * scene.frames[frame].world_from_camera;
          const Vector3d in_camera((column + scale / 2. - 16) / 32, (row + scale / 2. - 12) / 32, 1);
          CHECK((origin_of(rays, r) - pose.topRightCorner<3, 1>()).norm() < 1e-5);
          CHECK((direction_of(rays, r) - pose.topLeftCorner<3, 3>() * in_camera.normalized()).norm() < 1e-5);
        }
  }
}

TEST_CASE("patches: the actors that their rays meet are marked, and those out of sight are not") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 5});
  scene.actors = {toy_actor("ahead", {2, 1, 1.5}, 15, 4), toy_actor("around the corner", {1, 9, 4}, 3, -6),
                  toy_actor("behind", {2, 2, 2}, -9, 0), toy_actor("beside", {5, 2, 2}, 1, 2),
                  toy_actor("gone", {2, 4, 3}, 12, 0)};
  scene.actors[4].boxes.resize(1);
  scene.actors[4].boxes[0].timestamp = 7;
  const StreetSpace space(scene, {});
  const LogSource data(scene, toy_pixels(scene), {}, {space.street_from_world(), 1});
  const Eigen::Matrix4d world_from_street = space.street_from_world().inverse();
  std::size_t marked = 0, met = 0;
  for (uint64_t step = 0; step < 60; ++step) {
    HostRandom random(3, step);
    RayList rays;
    (void)data.add_patches(rays, random, 1 + int64_t(step) % 2, 6, {});
    REQUIRE(rays.actors.size() == scene.actors.size());
    CHECK_FALSE(rays.actors[2]);
    CHECK_FALSE(rays.actors[4]);
    for (std::size_t a = 0; a < scene.actors.size(); ++a) {
      marked += rays.actors[a];
      bool any = false;
      for (std::size_t r = 0; r < std::size_t(rays.count()); ++r)
        any = any || meets(scene.actors[a], rays.times[std::size_t(rays.moments[r])],
                           moved(world_from_street, origin_of(rays, r)),
                           world_from_street.topLeftCorner<3, 3>() * direction_of(rays, r));
      met += any;
      CHECK((rays.actors[a] || !any));
    }
  }
  CHECK(met > 30);
  CHECK(marked < 60 * 3);
}

TEST_CASE("object patches hold the box of an actor that is wholly in front of the camera") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 1});
  scene.actors = {toy_actor("ahead", {2, 4, 2}, 15, 2), toy_actor("behind", {2, 2, 2}, -9, 0),
                  toy_actor("beside", {5, 2, 2}, 1, 2), toy_actor("far", {0.5, 0.5, 0.5}, 29, -4)};
  // "ahead" reaches from x 14 to 16, y 0 to 4, z 0 to 2: its near side, of the camera at (0, 0, 1.5) with a focal
  // length of 32 pixels, from column 16 - 32 * 4 / 14 to 16 and from row 12 - 32 * 0.5 / 14 to 12 + 32 * 1.5 / 14.
  const Region whole = {6, 10, 10, 6};
  const StreetSpace space(scene, {});
  const LogSource data(scene, toy_pixels(scene), {}, {space.street_from_world(), 1});
  for (const int64_t longest : {48, 5}) {
    CAPTURE(longest);
    HostRandom random(1, 2);
    RayList rays;
    rays.actors.assign(scene.actors.size(), false);
    const Photographed patch = data.add_object(rays, random, {1, longest}, {});
    REQUIRE(patch.truth);
    const int64_t columns = patch.truth.dim(3), rows = patch.truth.dim(2);
    CHECK(columns == std::min(longest, whole.columns));
    CHECK(rows == std::min(longest, whole.rows));
    CHECK(rays.count() == rows * columns);
    CHECK(rays.actors[0]);
    // The photo's red and green tell columns and rows.
    const std::vector<float> truth = patch.truth.to_host();
    const auto column = std::lround(255 * truth[0]) / 7,
               row = std::lround(255 * truth[static_cast<std::size_t>(rows * columns)]) / 9;
    CHECK((column >= whole.x && column + columns <= whole.x + whole.columns));
    CHECK((row >= whole.y && row + rows <= whole.y + whole.rows));
  }
  HostRandom random(1, 2);
  RayList rays;
  const Photographed image = data.add_image(rays, random, {8, 48}, {});
  REQUIRE(image.objects.size() == 1);
  CHECK(image.objects[0].x == whole.x);
  CHECK(image.objects[0].rows == whole.rows);
}

TEST_CASE("objects and patches around actors are drawn by class first") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 1});
  // Ten trucks, of two labels, on the left of the picture and one bus on its right; a patch there shows its middle.
  for (int i = 0; i < 10; ++i) {
    scene.actors.push_back(toy_actor(text("truck ", i), {1, 2, 2}, 15, 3));
    scene.actors.back().label = i < 5 ? "Pickup Truck" : "Semi-truck";
  }
  scene.actors.push_back(toy_actor("bus", {1, 2, 2}, 15, -3));
  scene.actors.back().label = "Bus";
  const StreetSpace space(scene, {});
  const LogSource data(scene, toy_pixels(scene), {}, {space.street_from_world(), 1});
  const int draws = 400;
  int buses = 0, patches_right = 0;
  for (uint64_t step = 0; step < draws; ++step) {
    HostRandom random(5, step);
    RayList rays;
    rays.actors.assign(scene.actors.size(), false);
    REQUIRE(data.add_object(rays, random, {1, 48}, {}).truth);
    buses += rays.actors[10];
    // The first patch lies anywhere, the second around an actor.
    const std::vector<float> truth = data.add_patches(rays, random, 2, 4, {}).truth.to_host();
    patches_right += std::lround(255 * truth[3 * 4 * 4]) / 7 >= 14;
  }
  // Half of the draws, and not an eleventh: 200 with a standard deviation of 10.
  CHECK(std::abs(buses - draws / 2) < 50);
  CHECK(std::abs(patches_right - draws / 2) < 50);
}

TEST_CASE("the objects of a step's shares are alike in size, and each is drawn as often as if it were alone") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 1});
  constexpr size_t kCars = 6;
  for (size_t i = 0; i < kCars; ++i)
    scene.actors.push_back(toy_actor(text("car ", i), {1, 1 + 0.5 * static_cast<double>(i), 2}, 8, 0));
  const StreetSpace space(scene, {});
  const LogSource data(scene, toy_pixels(scene), {}, {space.street_from_world(), 1});
  const auto cells_of = [&](uint64_t step, const Share& share) {
    HostRandom random(5, step);
    RayList rays;
    rays.actors.assign(scene.actors.size(), false);
    REQUIRE(data.add_object(rays, random, {1, 48}, share).truth);
    return rays.count();
  };
  std::map<int64_t, int> drawn;
  constexpr int kSteps = 600;
  double apart = 0, apart_alone = 0;
  const auto difference = [](int64_t a, int64_t b) {
    return std::abs(static_cast<double>(a - b)) / static_cast<double>(a + b);
  };
  for (uint64_t step = 0; step < kSteps; ++step) {
    const int64_t one = cells_of(step, {0, 2}), other = cells_of(step, {1, 2});
    ++drawn[one], ++drawn[other];
    apart += difference(one, other) / kSteps;
    apart_alone += difference(cells_of(2 * step, {}), cells_of(2 * step + 1, {})) / kSteps;
  }
  CHECK(apart < 0.4 * apart_alone);
  CHECK(drawn.size() == kCars);
  // 200 each, with a standard deviation of 13, and more as those of a step go together.
  for (const auto& [cells, times] : drawn) CHECK(std::abs(times - 2 * kSteps / static_cast<int>(kCars)) < 70);
}

TEST_CASE("returns lie where the LiDAR saw them, and not on actors that are left out") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 3});
  scene.actors = {toy_actor("ahead", {2, 4, 3}, 12, 0), toy_actor("behind", {2, 2, 2}, -9, 0)};
  std::vector<LoadedSweep> sweeps;
  for (const Sweep& sweep : scene.sweeps) {
    LidarPoints points = load_sweep(scene, sweep);
    for (std::size_t i = 0; i < points.size(); i += 2) {  // half of all on the one behind, a quarter on the one ahead
      points.positions[3 * i] = i % 4 == 0 ? 11.f : -8.1f;
      points.positions[3 * i + 1] = 0;
      points.positions[3 * i + 2] = 1;
    }
    sweeps.push_back({&sweep, points});
  }
  sweeps.push_back({&scene.sweeps[0], {}});  // of nothing
  const StreetSpace space(scene, {});
  const LogSource data(scene, toy_pixels(scene), std::move(sweeps), {space.street_from_world(), 1});
  CHECK(data.sweeps().size() == 3);
  HostRandom random(1, 1);
  RayList rays;
  (void)data.add_patches(rays, random, 4, 24, {});  // whole pictures' height
  REQUIRE((rays.actors[0] && !rays.actors[1]));
  const auto first = static_cast<std::size_t>(rays.count());
  data.add_returns(rays, random, 400, {});
  const auto last = static_cast<std::size_t>(rays.count());
  CHECK(last > first + 200);
  CHECK(last < first + 380);
  const Eigen::Matrix4d world_from_street = space.street_from_world().inverse();
  std::size_t wall = 0, car = 0;
  for (std::size_t r = first; r < last; ++r) {
    CHECK(rays.moments[r] >= 4);
    CHECK((moved(world_from_street, origin_of(rays, r)) - Vector3d(0, 0, 2)).norm() < 1e-4);
    const Vector3d end = moved(world_from_street, origin_of(rays, r) + double{rays.ranges[r]} * direction_of(rays, r));
    wall += std::abs(end.x() - kToyWall) < 1e-3;
    car += (end - Vector3d(11, 0, 1)).norm() < 1e-3;
  }
  CHECK(wall + car == last - first);
  CHECK(car > 40);
}

TEST_CASE("returns of a moving LiDAR, and of a second one, are seen from where it was, among actors as they were") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 3});
  Actor crossing = toy_actor("crossing", {2, 4, 3}, 12, 0);
  for (ActorBox& box : crossing.boxes) box.world_from_box(1, 3) = 20 * box.timestamp;
  scene.actors = {crossing};
  const Vector3d velocity(8, 1, 0), second(0.4, 1.2, -0.4);
  std::vector<LoadedSweep> sweeps;
  for (Sweep& sweep : scene.sweeps) {
    sweep.velocity = velocity;
    sweep.second_lidar = second;
    LidarPoints points = load_sweep(scene, sweep);
    for (std::size_t i = 0; i < points.size(); ++i) {
      points.times[i] = 0.1f * static_cast<float>(i) / static_cast<float>(points.size()) - 0.05f;
      points.sensors[i] = i % 3 == 0;
      // All that it sees is the actor's middle, as it goes by.
      const double time = sweep.timestamp + double{points.times[i]};
      points.positions[3 * i] = 12, points.positions[3 * i + 1] = static_cast<float>(20 * time);
      points.positions[3 * i + 2] = static_cast<float>(i % 3);
    }
    sweeps.push_back({&sweep, points});
  }
  const StreetSpace space(scene, {});
  const LogSource data(scene, toy_pixels(scene), std::move(sweeps), {space.street_from_world(), 1});
  HostRandom random(1, 1);
  RayList rays;
  data.add_returns(rays, random, 400, {});
  REQUIRE(rays.count() == 400);
  const Eigen::Matrix4d world_from_street = space.street_from_world().inverse();
  for (std::size_t r = 0; r < 400; ++r) {
    const Vector3d from = moved(world_from_street, origin_of(rays, r)),
                   end = moved(world_from_street, origin_of(rays, r) + double{rays.ranges[r]} * direction_of(rays, r));
    const double seen = end.y() / 20, sweep = 0.1 * std::lround(seen / 0.1);  // the actor is a clock
    CHECK(std::abs(rays.times[std::size_t(rays.moments[r])] - seen) < 0.0026);
    const Vector3d first = Vector3d(0, 0, 2) + (seen - sweep) * velocity;
    CHECK((from - (end.z() < 0.5 ? Vector3d(first + second) : first)).norm() < 1e-3);
  }
  rays.actors = {false};
  data.add_returns(rays, random, 400, {});
  CHECK(rays.count() == 400);  // all of them are of the actor
}

TEST_CASE("images smaller than the pixels that a ray stands for, and logs without images, are errors") {
  const Folder folder;
  const Scene scene = toy_street(folder.path);
  const LogSource data(scene, toy_pixels(scene), {}, {Eigen::Matrix4d::Identity(), 64});
  CHECK_THROWS_AS((void)data.patch_side(8), Error);
  CHECK_THROWS_AS(LogSource(scene, Pixels{}, {}, {Eigen::Matrix4d::Identity(), 1}), Error);
}
