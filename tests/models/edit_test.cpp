// Edits of actors against where the boxes must be, and the LiDAR of an edited log against a street in closed form.
#include "models/scene/edit.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "models/data/path_file.h"
#include "models/street/simulate.h"
#include "runtime/error.h"
#include "tests/models/analytic_street.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;
using Eigen::Vector3d;

namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kSteps = 4;

Eigen::Matrix4d pose(double yaw, const Vector3d& position) {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = Eigen::AngleAxisd(yaw, Vector3d::UnitZ()).toRotationMatrix();
  m.topRightCorner<3, 1>() = position;
  return m;
}

/// A LiDAR 2 m above the ground; a parked car 10 m before it, a truck beside that, a van that crosses further back.
Scenes street_scenes() {
  Scene log;
  log.is_log = true;
  log.actors = {{"car", "Car", {2, 4, 1.5}, true, {}},
                {"truck", "Truck", {2.5, 7, 3}, true, {}},
                {"van", "Van", {2, 5, 2}, false, {}}};
  for (int step = 0; step < kSteps; ++step) {
    const double time = 100 + 0.1 * step;
    log.sweeps.push_back({"", time, pose(0.2, {0.5, 0, 2}), step, Split::train});
    log.actors[0].boxes.push_back({step, time, pose(0.3, {0, 10, 0.75})});
    log.actors[1].boxes.push_back({step, time, pose(0, {6, 12, 1.5})});
    log.actors[2].boxes.push_back({step, time, pose(kPi / 2, {-8.0 + step, 20, 1})});
  }
  return {log};
}

const AssetName kCar{0, "car"}, kTruck{0, "truck"}, kVan{0, "van"};

Vector3d centre(const Actor& actor, std::size_t box) {
  return actor.boxes.at(box).world_from_box.topRightCorner<3, 1>();
}

/// What a LiDAR of 1 degree would have returned, at one step; every seventh return is the second one's.
LidarPoints recorded_sweep(AnalyticStreet& street, const Sweep& sweep) {
  WorldRays rays{0, sweep.timestamp, {}, {}};
  std::vector<float> times;
  for (int pitch = -25; pitch <= 5; ++pitch) {
    for (int azimuth = -70; azimuth <= 70; ++azimuth) {
      const double a = azimuth * kPi / 180 + 1e-3, p = pitch * kPi / 180 + 1e-3;
      const Vector3d d(std::cos(p) * std::sin(a), std::cos(p) * std::cos(a), std::sin(p));
      times.push_back(sweep.velocity ? static_cast<float>(azimuth) * 0.0007f : 0);
      const SeenFrom from = seen_from(sweep, times.size() % 7 == 1, double{times.back()});
      if (sweep.velocity) rays.times.push_back(from.time);
      for (int axis = 0; axis < 3; ++axis) {
        rays.origins.push_back(static_cast<float>(from.origin[axis]));
        rays.directions.push_back(static_cast<float>(d[axis]));
      }
    }
  }
  const LidarReturns returns = street.measure(rays);
  LidarPoints points;
  for (std::size_t r = 0; r < returns.depths.size(); ++r) {
    if (returns.depths[r] <= 0) continue;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      points.positions.push_back(rays.origins[3 * r + axis] + returns.depths[r] * rays.directions[3 * r + axis]);
    }
    points.intensities.push_back(static_cast<float>(r % 256) / 255);
    points.times.push_back(times[r]);
    points.sensors.push_back(r % 7 == 0);
  }
  return points;
}

Vector3d point(const LidarPoints& points, std::size_t i) {
  return Eigen::Map<const Eigen::Vector3f>(&points.positions[3 * i]).cast<double>();
}

bool inside(const Actor& actor, std::size_t box, const Vector3d& p, double margin) {
  const Vector3d q = (actor.boxes.at(box).world_from_box.inverse() * p.homogeneous()).head<3>();
  return (q.cwiseAbs() - 0.5 * actor.size).maxCoeff() < margin;
}

std::size_t count_inside(const LidarPoints& points, const Actor& actor, std::size_t box, double margin) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < points.size(); ++i) count += inside(actor, box, point(points, i), margin);
  return count;
}

struct Simulated {
  Scenes before = street_scenes(), after = before;
  LidarPoints recorded;
  SweepEdit edit;

  explicit Simulated(const std::vector<std::pair<AssetName, ActorEdit>>& edits, std::optional<int> ghost_owner = {}) {
    for (const auto& [actor, change] : edits) apply(change, after, actor);
    AnalyticStreet then(before), now(after);
    const Sweep& sweep = before[0].sweeps[1];
    recorded = recorded_sweep(then, sweep);
    if (ghost_owner) {
      now.ghost_owner = *ghost_owner;
      // the background has kept a plate within the car's box
      now.ghost = [](const Vector3d& o, const Vector3d& d) {
        const double t = (10 - o.y()) / d.y();
        const Vector3d at = o + t * d;
        return t > 0 && std::abs(at.x()) < 0.8 && at.z() < 1.2 ? t : std::numeric_limits<double>::infinity();
      };
    }
    edit = edited_sweep(now, {before[0], after[0]}, sweep, recorded);
  }
};

std::string usage_error(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return (error.fault() == Fault::usage ? "usage: " : "data: ") + std::string(error.what());
  }
  return "no error";
}

}  // namespace

TEST_CASE("shift goes along the box's axes, rotate turns it on its place, and edits compose") {
  Scenes scenes = street_scenes();
  apply(Shift{{1, 0, 0}}, scenes, kVan);  // it drives along -x, so its right is +y
  CHECK((centre(scenes[0].actors[2], 1) - Vector3d(-7, 21, 1)).norm() < 1e-12);
  apply(Turn{kPi / 2}, scenes, kVan);
  CHECK((centre(scenes[0].actors[2], 1) - Vector3d(-7, 21, 1)).norm() < 1e-12);
  const Vector3d ahead = scenes[0].actors[2].boxes[1].world_from_box.block<3, 1>(0, 1);
  CHECK((ahead - Vector3d(0, -1, 0)).norm() < 1e-12);  // from -x counter-clockwise
  apply(Shift{{0, 2, 0}}, scenes, kVan);
  CHECK((centre(scenes[0].actors[2], 3) - Vector3d(-5, 19, 1)).norm() < 1e-12);
  CHECK((centre(scenes[0].actors[0], 0) - Vector3d(0, 10, 0.75)).norm() == 0);
  CHECK(differs(scenes[0].actors[2], street_scenes()[0].actors[2]));
  CHECK_FALSE(differs(scenes[0].actors[0], street_scenes()[0].actors[0]));
}

TEST_CASE("remove leaves the actor in its place of the list, without boxes; only a path brings it back") {
  Scenes scenes = street_scenes();
  apply(Remove{}, scenes, kCar);
  CHECK(scenes[0].actors[0].id == "car");
  CHECK(scenes[0].actors[0].boxes.empty());
  CHECK(usage_error([&] { apply(Shift{{1, 0, 0}}, scenes, kCar); }).find("no boxes to move") != std::string::npos);
  apply(Follow{{{0, {1, 2, 0.75}, 0.5}}}, scenes, kCar);
  REQUIRE(scenes[0].actors[0].boxes.size() == kSteps);
  CHECK(scenes[0].actors[0].stationary);
  CHECK(scenes[0].actors[0].boxes[2].world_from_box.isApprox(pose(0.5, {1, 2, 0.75})));
  CHECK(differs(scenes[0].actors[0], street_scenes()[0].actors[0]));
}

TEST_CASE("replace takes looks and size, and stands on the same ground") {
  Scenes scenes = street_scenes();
  const Replace by_car = replace_by(scenes, kCar);
  apply(replace_by(scenes, kTruck), scenes, kCar);
  const Actor &car = scenes[0].actors[0], &truck = scenes[0].actors[1];
  CHECK(car.asset == kTruck);
  CHECK(car.size == Vector3d(2.5, 7, 3));
  CHECK(centre(car, 0).z() == doctest::Approx(1.5));
  CHECK_FALSE(size_of_appearance(scenes, kCar).has_value());  // nobody looks like the car any more
  apply(by_car, scenes, kTruck);                              // as the car was: a swap
  CHECK(truck.asset == kCar);
  CHECK(truck.size == Vector3d(2, 4, 1.5));
  CHECK(centre(truck, 0).z() == doctest::Approx(0.75));
  CHECK(size_of_appearance(scenes, kCar).value() == Vector3d(2, 4, 1.5));
  apply(replace_by(scenes, kCar), scenes, kVan);  // looks travel on: the car's are the truck's
  CHECK(scenes[0].actors[2].asset == kTruck);
  CHECK(centre(scenes[0].actors[2], 0).z() == doctest::Approx(1.5));
  apply(replace_by(scenes, kTruck), scenes, kCar);  // its own again
  CHECK_FALSE(car.asset.has_value());
  CHECK_FALSE(differs(car, street_scenes()[0].actors[0]));
}

TEST_CASE("a path gives boxes at the steps in its time, yaw the shorter way round") {
  Scenes scenes = street_scenes();
  const double full = 2 * kPi;
  apply(Follow{{{100.05, {0, 0, 1}, full - 0.1}, {100.25, {4, 2, 1}, 0.3}}}, scenes, kVan);
  const Actor& van = scenes[0].actors[2];
  REQUIRE(van.boxes.size() == 2);  // at 100.1 and 100.2
  CHECK(van.boxes[0].step == 1);
  CHECK(van.boxes[0].world_from_box.isApprox(pose(0, {1, 0.5, 1}), 1e-9));
  CHECK(van.boxes[1].world_from_box.isApprox(pose(0.2, {3, 1.5, 1}), 1e-9));
  CHECK_FALSE(van.stationary);
  CHECK(van.follows_path);
  const std::string late = usage_error([&] {
    apply(Follow{{{5, Vector3d::Zero(), 0}, {6, Vector3d::Zero(), 0}}}, scenes, kVan);
  });
  CHECK_MESSAGE(late.find("the log from 100.0") != std::string::npos, late);
  CHECK(usage_error([&] {
          apply(Follow{{{6, Vector3d::Zero(), 0}, {5, Vector3d::Zero(), 0}}}, scenes, kVan);
        }).find("backwards in time") != std::string::npos);
}

TEST_CASE("path files: CSV and JSON say the same, and what is wrong is named by line") {
  const Folder own;
  const fs::path& folder = own.path;
  const auto read = [&](const std::string& content) {
    std::ofstream(folder / "p") << content;
    return read_path_file(folder / "p");
  };
  for (const char* content : {"time,x,y,z,yaw\n0.5,1,2,3,-1.5\r\n1, 4, 5, 6, 7\n",
                              R"([{"time":0.5,"x":1,"y":2,"z":3,"yaw":-1.5},{"time":1,"x":4,"y":5,"z":6,"yaw":7}])"}) {
    const auto path = read(content);
    REQUIRE(path.size() == 2);
    CHECK(path[0].time == 0.5);
    CHECK(path[0].position == Vector3d(1, 2, 3));
    CHECK(path[0].yaw == -1.5);
    CHECK(path[1].position == Vector3d(4, 5, 6));
  }
  for (const char* content : {"time,x,y,z,yaw\n1,2,3,4\n", "time,x,y,z,yaw\n1,2,3,4,5,6\n", "1,2,3,4,5\n", "",
                              "time,x,y,z,yaw\n", "time,x,y,z,yaw\n1,nan,3,4,5\n", "time,x,y,z,yaw\n1,1e9,3,4,5\n",
                              R"([{"time":1}])", R"({"time":1})", "[]", "[1"}) {
    CAPTURE(content);
    CHECK(usage_error([&] { read(content); }).starts_with("data: "));
  }
}

TEST_CASE("simulate without an edit gives back every bit") {
  const Simulated s({});
  REQUIRE(s.recorded.size() > 3000);
  CHECK(s.edit.measured == 0);
  CHECK(s.edit.points.positions == s.recorded.positions);
  CHECK(s.edit.points.intensities == s.recorded.intensities);
}

TEST_CASE("simulate with remove: no return of the actor, what is behind it instead, all else as it was") {
  for (const std::optional<int> ghost : {std::optional<int>(), std::optional(0), std::optional(2)}) {
    CAPTURE(ghost.value_or(-1));
    const Simulated s({{kCar, Remove{}}}, ghost);
    const Actor& car = s.before[0].actors[0];
    const std::size_t on_car = count_inside(s.recorded, car, 1, 1e-3);
    CHECK(on_car > 50);
    CHECK(count_inside(s.edit.points, car, 1, -1e-4) == 0);
    CHECK(s.edit.gone == 0);  // there is a wall behind everything
    REQUIRE(s.edit.points.size() == s.recorded.size());
    AnalyticStreet empty(s.after);
    for (std::size_t i = 0; i < s.recorded.size(); ++i) {
      const Vector3d was = point(s.recorded, i), is = point(s.edit.points, i), origin(0.5, 0, 2);
      if (!inside(car, 1, was, 0.2)) {
        CHECK(was == is);
        continue;
      }
      const Vector3d d = (was - origin).normalized();
      const Eigen::Vector3f o = origin.cast<float>(), f = d.cast<float>();
      const LidarReturns truth = empty.measure({0, 100.1, {o.x(), o.y(), o.z()}, {f.x(), f.y(), f.z()}});
      CHECK((origin + double(truth.depths[0]) * d - is).norm() < 2e-3);
    }
    CHECK(s.edit.points.intensities == s.recorded.intensities);
    CHECK(s.edit.points.sensors == s.recorded.sensors);
  }
}

TEST_CASE("simulate: each return is seen from its own LiDAR at its own time") {
  Scenes before = street_scenes();
  before[0].sweeps[1].velocity = {6, 2, 0};
  before[0].sweeps[1].second_lidar = {0.4, 1.2, -0.4};
  Scenes after = before;
  apply(Shift{{3, 0, 0}}, after, kVan);  // to its right, and it drives
  apply(Remove{}, after, kCar);
  AnalyticStreet then(before), now(after);
  const Sweep& sweep = before[0].sweeps[1];
  const LidarPoints recorded = recorded_sweep(then, sweep), truth = recorded_sweep(now, sweep);
  const SweepEdit edit = edited_sweep(now, {before[0], after[0]}, sweep, recorded);
  REQUIRE(truth.size() == edit.points.size());
  double worst = 0;
  for (std::size_t i = 0; i < truth.size(); ++i)
    worst = std::max(worst, (point(truth, i) - point(edit.points, i)).norm());
  CHECK(worst < 2e-3);
  CHECK(edit.changed > 100);
}

TEST_CASE("simulate with shift: the actor's returns move with it") {
  const Simulated s({{kCar, Shift{{-4, 0, 0}}}});
  const Actor &was = s.before[0].actors[0], &is = s.after[0].actors[0];
  CHECK(count_inside(s.edit.points, was, 1, -1e-3) == 0);
  AnalyticStreet street(s.after);
  const LidarPoints truth = recorded_sweep(street, s.before[0].sweeps[1]);
  // Every beam came back before and after, so the exact sweep of the edited street has the same order.
  REQUIRE(truth.size() == s.edit.points.size());
  CHECK(count_inside(truth, is, 1, 1e-3) > 50);
  double worst = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    worst = std::max(worst, (point(truth, i) - point(s.edit.points, i)).norm());
  }
  CHECK(worst < 2e-3);
  CHECK(s.edit.measured < s.recorded.size() / 2);
}

TEST_CASE("simulate with new looks: returns that touch neither the old box nor the new one stay to the bit") {
  const AssetName made{1, "generated"};
  for (const Vector3d& size : {Vector3d(1.6, 3, 1.2), Vector3d(2.6, 5.5, 2.4)}) {
    const Simulated s({{kCar, Replace{made, size}}});
    const Actor &was = s.before[0].actors[0], &is = s.after[0].actors[0];
    CHECK(is.size == size);
    CHECK(centre(is, 1).z() == doctest::Approx(size.z() / 2));
    REQUIRE(s.edit.points.size() == s.recorded.size());
    AnalyticStreet street(s.after);
    const LidarPoints truth = recorded_sweep(street, s.before[0].sweeps[1]);
    std::size_t untouched = 0, on_it = 0;
    for (std::size_t i = 0; i < s.recorded.size(); ++i) {
      const Vector3d before = point(s.recorded, i), after = point(s.edit.points, i), now = point(truth, i);
      CHECK((now - after).norm() < 2e-3);
      on_it += inside(is, 1, after, 1e-3);
      if (inside(was, 1, before, 0.21) || inside(is, 1, now, 0.01)) continue;
      CHECK(before == after);
      ++untouched;
    }
    CHECK(untouched > s.recorded.size() / 2);
    CHECK(on_it > 40);
  }
}

TEST_CASE("simulate: what was recorded before the actor's own surface stays, also within its new box") {
  Scenes before = street_scenes(), after = before;
  apply(Shift{{-4, 0, 0}}, after, kCar);
  AnalyticStreet street(after);
  street.sunk = 1;
  const Actor& car = after[0].actors[0];
  const Vector3d middle = centre(car, 1), origin(0.5, 0, 2), along = (middle - origin).normalized();
  const Vector3d face =
      origin +
      along * double(street.measure({0, 100.1, {0.5f, 0, 2}, {float(along.x()), float(along.y()), float(along.z())}})
                         .depths[0]);
  LidarPoints recorded;
  for (const double behind : {-0.5, 0.5}) {
    const Vector3d p = face + behind * along;
    for (int axis = 0; axis < 3; ++axis) recorded.positions.push_back(static_cast<float>(p[axis]));
    recorded.intensities.push_back(1);
    recorded.times.push_back(0);
    recorded.sensors.push_back(0);
  }
  const SweepEdit edit = edited_sweep(street, {before[0], after[0]}, before[0].sweeps[1], recorded);
  CHECK(edit.measured == 2);
  CHECK(edit.changed == 1);
  CHECK(point(edit.points, 0) == point(recorded, 0));
  CHECK((point(edit.points, 1) - face).norm() < 1e-4);
}

TEST_CASE("simulate: a beam that nothing sends back any more has no return") {
  Scenes before = street_scenes();
  before[0].actors[1].boxes[1].world_from_box = pose(0, {0, -10, 2.5});  // behind the LiDAR, where no wall is
  Scenes after = before;
  apply(Remove{}, after, kTruck);
  AnalyticStreet street(after);
  const LidarPoints recorded{{0.5f, -6.5f, 2.5f, 1, 5, 0}, {1, 0.5f}, {0, 0}, {0, 0}, 0};
  const SweepEdit edit = edited_sweep(street, {before[0], after[0]}, before[0].sweeps[1], recorded);
  CHECK(edit.gone == 1);
  REQUIRE(edit.points.size() == 1);
  CHECK(edit.points.intensities[0] == 0.5f);
}

namespace {

/// A street that knows intensities, and that nothing comes back from the left half of what it is asked.
struct KnowingStreet final : AnalyticStreet {
  using AnalyticStreet::AnalyticStreet;
  LidarReturns measure(const WorldRays& rays) override {
    LidarReturns returns = AnalyticStreet::measure(rays);
    for (std::size_t r = 0; r < returns.depths.size(); ++r) {
      returns.intensities.push_back(0.125f);
      returns.drops.push_back(rays.directions[3 * r] < 0 ? 0.9f : 0.1f);
    }
    return returns;
  }
};

}  // namespace

TEST_CASE("simulation: changed returns have the street's intensity, and none comes back where it says so") {
  Scenes before = street_scenes(), after = before;
  apply(Shift{{0, 3, 0}}, after, kCar);
  AnalyticStreet then(before), plain(after);
  KnowingStreet knowing(after);
  const Sweep& sweep = before[0].sweeps[1];
  const LidarPoints recorded = recorded_sweep(then, sweep);
  const SweepEdit without = edited_sweep(plain, {before[0], after[0]}, sweep, recorded),
                  with = edited_sweep(knowing, {before[0], after[0]}, sweep, recorded);
  CHECK(with.changed > 20);
  CHECK(with.gone > without.gone + 10);
  std::size_t changed = 0;
  const Vector3d lidar = sweep.world_from_lidar.topRightCorner<3, 1>();
  for (std::size_t i = 0; i < with.points.size(); ++i) {
    if (with.points.intensities[i] != 0.125f) continue;
    ++changed;
    CHECK(point(with.points, i).x() >= lidar.x() - 1e-3);
  }
  CHECK(changed == with.changed - with.gone);
}
