// What a log's LiDAR says about where something is, and what rays save by it.
#include "models/street/street_space.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "models/scene/asset_class.h"
#include "models/scene/assets.h"
#include "models/street/static_surface.h"
#include "runtime/error.h"
#include "runtime/ops/composite.h"
#include "runtime/ops/street.h"
#include "tests/models/toy_street.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

/// Ground and wall, and a bus that the LiDAR sees the side of.
/// The voxels of a space, on the host.
struct Voxels {
  explicit Voxels(const StreetSpace& space)
      : numbers(space.grid().numbers.to_host()), cells(space.grid().cells.to_host<uint8_t>()) {}
  /// Is the one at this point (street axes, metres) occupied? Outside the grid: no.
  bool occupied(const Eigen::Vector3d& point) const {
    std::size_t place = 0;
    for (const std::size_t axis : {2u, 1u, 0u}) {
      const double at =
          std::floor((point[static_cast<Eigen::Index>(axis)] - double{numbers[axis]}) / double{numbers[3]});
      if (at < 0 || at >= double{numbers[4 + axis]}) return false;
      place = place * static_cast<std::size_t>(numbers[4 + axis]) + static_cast<std::size_t>(at);
    }
    return cells[place] != 0;
  }
  double occupied_share() const {
    return static_cast<double>(std::count(cells.begin(), cells.end(), 1)) / static_cast<double>(cells.size());
  }
  std::vector<float> numbers;
  std::vector<uint8_t> cells;
};

struct Seen {
  Seen() {
    scene = toy_street(folder.path, {.frames = 3});
    scene.actors = {toy_actor("bus", {4, 2, 3.5}, 15, 5)};
    for (double y = -20; y <= 20; y += 0.3) {
      for (double x = 2; x < kToyWall; x += 0.3)
        if (!under_bus(x, y)) add(still, {x, y, 0.01});
      for (double z = 0; z < 6; z += 0.3) add(still, {kToyWall, y, z});
    }
    for (double z = 2.2; z < 3.4; z += 0.1) add(moving, {13.5, 5, z});
    points = still;
    points.insert(points.end(), moving.begin(), moving.end());
    lidar.positions = points;
    lidar.sensors.resize(points.size() / 3);
  }
  static bool under_bus(double x, double y) { return std::abs(x - 15) < 2.3 && std::abs(y - 5) < 1.3; }
  static void add(std::vector<float>& to, const Vector3d& p) {
    for (int k = 0; k < 3; ++k) to.push_back(static_cast<float>(p[k]));
  }
  StreetSpace space(const StreetSpaceOptions& options) const {
    StreetSpace out(scene, options);
    out.look(scene, std::vector<LoadedSweep>{{&scene.sweeps[0], lidar}});
    return out;
  }
  Folder folder;
  Scene scene;
  std::vector<float> still, moving, points;
  LidarPoints lidar;
};

const Seen& seen() {
  static const Seen made;
  return made;
}

Vector3d in_street(const StreetSpace& space, const std::vector<float>& points, std::size_t at) {
  const Vector3d world(points[at], points[at + 1], points[at + 2]);
  return (space.street_from_world() * world.homogeneous()).head<3>();
}

struct Fan {
  StreetRays rays;
  std::vector<Vector3d> directions;
};

constexpr double kEye = 1.7;

/// Rays from above the origin of the world, ahead and to all sides.
Fan fan(const StreetSpace& space) {
  Fan out;
  std::vector<float> origins, directions;
  const Eigen::Matrix4d& to = space.street_from_world();
  const Vector3d eye = (to * Vector3d(0, 0, kEye).homogeneous()).head<3>();
  for (int i = 0; i < 400; ++i) {
    const double across = 0.07 * (i % 20 - 9.6), up = 0.02 * (i / 20 - 12.3);
    const Vector3d way = Vector3d(1, across, up).normalized();
    out.directions.push_back(way);
    Seen::add(origins, eye);
    Seen::add(directions, to.topLeftCorner<3, 3>() * way);
  }
  out.rays = {from_host(origins, {400, 3}), from_host(directions, {400, 3}),
              from_host(std::vector<float>(800, 0.5f), {400, 2}), from_host(std::vector<int32_t>(400, 0), {400})};
  return out;
}

/// Where a ray of the fan meets ground or wall.
double distance(const Vector3d& way) {
  const double wall = kToyWall / way.x();
  return way.z() < 0 ? std::min(wall, -kEye / way.z()) : wall;
}

StreetSamples samples(const Fan& rays, const StreetSpace& space) {
  return street_samples(rays.rays, pack_boxes({{}}), space.grid(), {});
}

/// Opacity and depth of rays when the world is what the LiDAR saw of it and nothing else.
std::vector<float> blended(const Fan& rays, const StreetSamples& s) {
  const std::vector<int32_t> offsets = s.offsets.to_host<int32_t>(), rows = s.rows.to_host<int32_t>();
  const std::vector<float> t = s.t.to_host();
  std::vector<float> alpha(t.size(), 0.f);
  for (std::size_t r = 0; r < rays.directions.size(); ++r)
    for (auto i = static_cast<std::size_t>(offsets[r]); i < static_cast<std::size_t>(offsets[r + 1]); ++i)
      if (t[i] >= 0 && std::abs(double{t[i]} - distance(rays.directions[r])) < 0.4)
        alpha[static_cast<std::size_t>(rows[i])] = t[i] > distance(rays.directions[r]) - 0.1 ? 1.f : 0.3f;
  const auto count = static_cast<int64_t>(t.size());
  const Tensor both = composite({from_host(alpha, {count}), s.offsets, {}, s.rows, true}, {zeros({count, 1}), s.t});
  return slice(both, 1, 1, 3).to_host();
}

}  // namespace

TEST_CASE("what stands still is in occupied voxels, what drives is not, and most of the street is empty") {
  for (const int dilate : {0, 1}) {
    const StreetSpace space = seen().space({.dilate = dilate});
    const Voxels voxels(space);
    std::size_t missing = 0;
    for (std::size_t i = 0; i < seen().still.size(); i += 3)
      missing += !voxels.occupied(in_street(space, seen().still, i));
    CHECK(missing == 0);
    for (std::size_t i = 0; i < seen().moving.size(); i += 3)
      CHECK_FALSE(voxels.occupied(in_street(space, seen().moving, i)));
    CHECK(voxels.occupied_share() < 0.5);
  }
  Scene without = seen().scene;
  without.actors.clear();
  StreetSpace space(without, {});
  space.look(without, std::vector<LoadedSweep>{{&without.sweeps[0], seen().lidar}});
  CHECK(Voxels(space).occupied(in_street(space, seen().moving, 0)));  // nobody says that it drives
}

TEST_CASE("street axes: x along the cameras' way, z up, right-handed, metres, about the middle of the track") {
  const StreetSpace space(seen().scene, {});
  const Eigen::Matrix4d& to = space.street_from_world();
  CHECK((to.topLeftCorner<3, 3>() * to.topLeftCorner<3, 3>().transpose()).isIdentity(1e-9));
  CHECK(to.topLeftCorner<3, 3>().determinant() == doctest::Approx(1));
  CHECK((to.row(2).head<3>().transpose() - Vector3d::UnitZ()).norm() < 1e-9);
  // These cameras drive less than a metre: their first sight counts.
  CHECK((to.row(0).head<3>().transpose() - Vector3d::UnitX()).norm() < 1e-9);
  Scene drives = seen().scene;
  drives.frames[1].world_from_camera = toy_camera_pose(7);  // and back again
  const StreetSpace along(drives, {});
  CHECK((along.street_from_world().row(0).head<3>().transpose() - Vector3d::UnitY()).norm() < 1e-9);
  CHECK((along.street_from_world() * Eigen::Vector4d(0, 3.5, 1.5, 1)).head<3>().norm() < 1e-9);
}

TEST_CASE("rays leave empty voxels out, see the same and need a fifth of the samples") {
  StreetSpace all(seen().scene, {});
  const StreetSpace some = seen().space({});
  const Fan from_all = fan(all), from_some = fan(some);
  const StreetSamples many = samples(from_all, all), few = samples(from_some, some);
  const std::vector<float> want = blended(from_all, many), got = blended(from_some, few);
  REQUIRE(want.size() == got.size());
  int met = 0;
  for (std::size_t r = 0; r < from_all.directions.size(); ++r) {
    CAPTURE(r);
    const double depth = distance(from_all.directions[r]);
    const Vector3d hit = Vector3d(0, 0, kEye) + depth * from_all.directions[r];
    // Where the LiDAR saw something.
    if (hit.x() < 3 || std::abs(hit.y()) > 18 || hit.z() > 5 || Seen::under_bus(hit.x(), hit.y())) continue;
    met++;
    CHECK(want[2 * r] == 1.f);
    CHECK(got[2 * r + 1] == doctest::Approx(want[2 * r + 1]).epsilon(1e-5));
    CHECK(got[2 * r] == doctest::Approx(want[2 * r]));
    CHECK(std::abs(double{got[2 * r + 1]} - depth) < 0.5);
  }
  CHECK(met > 200);
  CHECK(5 * few.t.dim(0) < many.t.dim(0));
}

TEST_CASE("what a LiDAR sees has a sample within a step, from wherever it looks") {
  const StreetSpace space = seen().space({});
  std::vector<float> origins, directions;
  std::vector<double> ranges;
  const Eigen::Matrix4d& to = space.street_from_world();
  const Vector3d lidar = (to * Vector3d(0, 0, 2).homogeneous()).head<3>();
  for (std::size_t i = 0; i < seen().still.size(); i += 3 * 7) {
    const Vector3d way = in_street(space, seen().still, i) - lidar;
    Seen::add(origins, lidar);
    Seen::add(directions, way.normalized());
    ranges.push_back(way.norm());
  }
  const auto count = static_cast<int64_t>(ranges.size());
  const Fan rays{{from_host(origins, {count, 3}), from_host(directions, {count, 3}),
                  from_host(std::vector<float>(2 * ranges.size(), 0.3f), {count, 2}),
                  from_host(std::vector<int32_t>(ranges.size(), 0), {count})},
                 {}};
  const StreetSamples s = samples(rays, space);
  const std::vector<int32_t> offsets = s.offsets.to_host<int32_t>();
  const std::vector<float> t = s.t.to_host();
  int missed = 0;
  for (std::size_t r = 0; r < ranges.size(); ++r) {
    double nearest = 1e30;
    for (auto i = static_cast<std::size_t>(offsets[r]); i < static_cast<std::size_t>(offsets[r + 1]); ++i)
      nearest = std::min(nearest, std::abs(double{t[i]} - ranges[r]));
    missed += nearest > double{StreetSteps{}.background};
  }
  CHECK(missed == 0);
}

TEST_CASE("a wall seen up to the edge of the LiDAR's sight goes on as far as cameras look") {
  const StreetSpace space = seen().space({});
  const auto at = [&](double z) {
    return Voxels(space).occupied((space.street_from_world() * Eigen::Vector4d(kToyWall, 0, z, 1)).head<3>());
  };
  // The toy camera looks half its height over its focal length upwards: to 1.5 + 30 * 12 / 32 = 12.75 m at the wall.
  CHECK(at(3));
  CHECK(at(12));
  CHECK_FALSE(at(15));
}

TEST_CASE(
    "the mesh of a street: ground and wall where the LiDAR saw them, in the world's axes, and nothing elsewhere") {
  Seen seen;
  for (Frame& frame : seen.scene.frames) frame.world_from_camera(1, 3) += 3;  // street and world lie apart
  const StreetSpace space = seen.space({});
  const Eigen::Matrix4d world_from_street = space.street_from_world().inverse();
  CHECK(world_from_street.topRightCorner<3, 1>().norm() > 3);
  // Ground below 0 and wall behind x = 30 as far as one can think; colours by the world's x.
  const Mesh mesh = static_mesh(
      space,
      [&](const std::vector<float>& points, bool coloured) {
        AssetSamples samples;
        for (std::size_t i = 0; i < points.size(); i += 3) {
          const Vector3d at =
              (world_from_street * Eigen::Vector4d(points[i], points[i + 1], points[i + 2], 1)).head<3>();
          samples.distances.push_back(static_cast<float>(std::min(at.z(), kToyWall - at.x())));
          for (int k = 0; coloured && k < 3; ++k) samples.colours.push_back(static_cast<float>(at.x() / 40));
        }
        return samples;
      },
      100);
  std::vector<Vector3d> vertices;
  for (std::size_t i = 0; i < mesh.positions.size(); i += 3) {
    const Vector3d at(mesh.positions[i], mesh.positions[i + 1], mesh.positions[i + 2]);
    CHECK(mesh.colours[i] == doctest::Approx(at.x() / 40).epsilon(1e-4));
    CHECK(std::min(at.z(), kToyWall - at.x()) < 0.15);  // nothing in the air; cells cut the corner
    if (at.z() > 1 && at.z() < 5 && std::abs(at.y()) < 15 && std::abs(at.x() - kToyWall) < 1e-3)
      CHECK(mesh.normals[i] < -0.7f);
    vertices.push_back(at);
  }
  std::size_t looked_for = 0;
  double worst = 0;
  for (std::size_t i = 0; i < seen.still.size(); i += 30) {
    const Vector3d at(seen.still[i], seen.still[i + 1], seen.still[i + 2]);
    if (at.x() < 4 || std::abs(at.y()) > 18 || at.z() > 5)
      continue;  // the box holds 96 % of the points along each axis
    double least = 1e9;
    for (const Vector3d& vertex : vertices) least = std::min(least, (vertex - at).norm());
    worst = std::max(worst, least);
    ++looked_for;
  }
  CHECK(looked_for > 100);
  CHECK(worst < 0.6);  // cells of 0.4 m
}

TEST_CASE("the grid survives its checkpoint, and a damaged one is an error") {
  const StreetSpace space = seen().space({.voxel = 0.7f});
  StreetSpace again(seen().scene, {});
  const TensorMap state = space.state();
  again.restore(state);
  CHECK(again.grid().cells.to_host<uint8_t>() == space.grid().cells.to_host<uint8_t>());
  CHECK(again.grid().blocks.to_host<uint8_t>() == space.grid().blocks.to_host<uint8_t>());
  CHECK(again.grid().numbers.to_host() == space.grid().numbers.to_host());
  for (const auto& [place, value] : {std::pair<std::size_t, float>{3, 0.f}, {4, 1e9f}, {5, -3.f}, {6, std::nanf("")}}) {
    CAPTURE(place);
    TensorMap damaged = state;
    std::memcpy(damaged.at("numbers").data.data() + 4 * place, &value, 4);
    CHECK_THROWS_AS(again.restore(damaged), Error);
  }
  TensorMap cut = state;
  cut.erase("cells");
  CHECK_THROWS_AS(again.restore(cut), Error);
}

TEST_CASE("classes of assets are those of Table A1") {
  const std::pair<const char*, const char*> rows[] = {{"Car", "Car"},
                                                      {"Pickup Truck", "Truck"},
                                                      {"Medium-sized Truck", "Truck"},
                                                      {"Semi-truck", "Truck"},
                                                      {"Bus", "Bus"},
                                                      {"Other Vehicle - Construction Vehicle", "Construction vehicle"},
                                                      {"Emergency Vehicle", "Emergency vehicle"},
                                                      {"Bicycle", "Bicycle"},
                                                      {"Motorcycle", "Motorcycle"},
                                                      {"Motorized Scooter", "Motorcycle"},
                                                      {"Pedestrian", "Pedestrian"},
                                                      {"Pedestrian with Object", "Pedestrian"},
                                                      // of KITTI
                                                      {"Van", "Truck"},
                                                      {"Person_sitting", "Pedestrian"},
                                                      {"Cyclist", "Bicycle"},
                                                      // the rest of PandaSet
                                                      {"Personal Mobility Device", "Other"},
                                                      {"Construction Signs", "Other"},
                                                      {"Other Vehicle - Pedicab", "Other"},
                                                      {"Other Vehicle - Uncommon", "Other"},
                                                      {"Towed Object", "Other"},
                                                      {"Animals - Other", "Other"},
                                                      {"Cones", "Other"},
                                                      {"", "Other"}};
  static_assert(std::size(kAssetClasses) == kAssetClassCount);
  for (const auto& [label, name] : rows) {
    CAPTURE(std::string(label));
    CHECK(std::string(kAssetClasses[asset_class(label)]) == name);
  }
}

TEST_CASE("vehicles and pedestrians are actors, what Table A1 does not list is background") {
  Scene scene;
  for (const char* label : {"Car", "Cones", "Pedestrian with Object", "Construction Signs", "Bicycle"}) {
    Actor actor;
    actor.id = actor.label = label;
    scene.actors.push_back(actor);
  }
  keep_road_users(scene);
  REQUIRE(scene.actors.size() == 3);
  CHECK(scene.actors[0].id == "Car");
  CHECK(scene.actors[1].id == "Pedestrian with Object");
  CHECK(scene.actors[2].id == "Bicycle");
  CHECK(scene.other_actors == 2);
}
