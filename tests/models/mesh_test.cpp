// Surfaces from distances against closed forms, and their files read back with other eyes.
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <sstream>

#include "models/mesh/density_mesh.h"
#include "models/mesh/isosurface.h"
#include "models/mesh/parts.h"
#include "models/mesh/write_mesh.h"
#include "models/street/asset_mesh.h"
#include "runtime/error.h"
#include "tests/models/analytic_street.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;
using Eigen::Vector3d;

namespace {

constexpr double kPi = std::numbers::pi;

using Distance = std::function<double(const Vector3d&)>;

/// A box about the origin, and a tenth more.
Eigen::AlignedBox3d box_of(const Vector3d& size) { return {-0.55 * size, 0.55 * size}; }

Implicit implicit(const Distance& distance) {
  return {[=](const std::vector<float>& points) {
    std::vector<float> values;
    for (std::size_t i = 0; i < points.size(); i += 3)
      values.push_back(static_cast<float>(distance({points[i], points[i + 1], points[i + 2]})));
    return values;
  }};
}

Mesh meshed(const Vector3d& size, int resolution, const Distance& distance) {
  return isosurface(grid_over(box_of(size), resolution), implicit(distance));
}

Vector3d row(const std::vector<float>& values, std::size_t index) {
  return {values[3 * index], values[3 * index + 1], values[3 * index + 2]};
}

struct Measures {
  double volume = 0, area = 0, least_area = std::numeric_limits<double>::infinity();
  std::size_t edges = 0;
  bool closed = true;  // each edge once in each direction
  long euler(std::size_t vertices, std::size_t faces) const { return long(vertices) - long(edges) + long(faces); }
};

Measures measure(const std::vector<float>& positions, const std::vector<std::uint32_t>& triangles) {
  Measures m;
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> directed;
  for (std::size_t t = 0; t < triangles.size(); t += 3) {
    const Vector3d a = row(positions, triangles[t]), b = row(positions, triangles[t + 1]),
                   c = row(positions, triangles[t + 2]);
    const double area = 0.5 * (b - a).cross(c - a).norm();
    m.volume += a.dot(b.cross(c)) / 6;
    m.area += area;
    m.least_area = std::min(m.least_area, area);
    for (std::size_t i = 0; i < 3; ++i) ++directed[{triangles[t + i], triangles[t + (i + 1) % 3]}];
  }
  for (const auto& [edge, count] : directed) {
    const auto back = directed.find({edge.second, edge.first});
    if (count != 1 || back == directed.end()) m.closed = false;
  }
  m.edges = directed.size() / 2;
  return m;
}

Measures measure(const Mesh& mesh) { return measure(mesh.positions, mesh.triangles); }

Distance sphere(double radius) {
  return [=](const Vector3d& p) { return p.norm() - radius; };
}

template <class Value>
Value value_at(const std::string& bytes, std::size_t offset) {
  Value value;
  REQUIRE(offset + sizeof(Value) <= bytes.size());
  std::memcpy(&value, bytes.data() + offset, sizeof(Value));
  return value;
}

template <class Value>
std::vector<Value> values_at(const std::string& bytes, std::size_t offset, std::size_t count) {
  std::vector<Value> values(count);
  for (std::size_t i = 0; i < count; ++i) values[i] = value_at<Value>(bytes, offset + i * sizeof(Value));
  return values;
}

/// A sphere that is red where x > 0, half-bright green elsewhere.
Mesh coloured_sphere() {
  Mesh mesh = meshed({2, 4, 2}, 24, [](const Vector3d& p) { return (p - Vector3d(0, 1, 0)).norm() - 0.8; });
  for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
    const bool right = mesh.positions[3 * v] > 0;
    mesh.colours.insert(mesh.colours.end(), {right ? 1.f : 0.f, right ? 0.f : 0.5f, 0.f});
  }
  return mesh;
}

}  // namespace

TEST_CASE("a grid covers the box with cubes, about its middle") {
  const Vector3d low(9, -2, 4), high(11, 3, 5.55);
  const NodeGrid grid = grid_over({low, high}, 50);
  CHECK(grid.spacing == doctest::Approx(0.1));
  CHECK(grid.counts[1] == 51);
  const Vector3d first = grid.position(0, 0, 0),
                 last = grid.position(grid.counts[0] - 1, grid.counts[1] - 1, grid.counts[2] - 1);
  CHECK((first + last - low - high).norm() < 1e-12);
  CHECK(last.y() == doctest::Approx(3));
  CHECK(last.z() >= 5.55);
  CHECK(last.z() < 5.55 + 0.1);
}

TEST_CASE("a sphere's surface: area, volume and normals of the closed form, closed and of genus 0") {
  const Mesh mesh = meshed({2, 2, 2}, 40, sphere(0.9));
  const Measures m = measure(mesh);
  CHECK(m.closed);
  CHECK(m.euler(mesh.vertex_count(), mesh.triangle_count()) == 2);
  CHECK(m.volume == doctest::Approx(4.0 / 3 * kPi * 0.729).epsilon(0.005));  // positive: outwards
  CHECK(m.area == doctest::Approx(4 * kPi * 0.81).epsilon(0.01));
  CHECK(m.least_area > 0);
  double worst = 1, mean = 0;
  for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
    const Vector3d p = row(mesh.positions, v);
    CHECK(std::abs(p.norm() - 0.9) < 2e-3);
    const double agreement = row(mesh.normals, v).dot(p.normalized());
    worst = std::min(worst, agreement);
    mean += agreement / double(mesh.vertex_count());
  }
  CHECK(worst > 0.95);
  CHECK(mean > 0.998);
}

TEST_CASE("a torus has a hole: Euler characteristic 0") {
  const Mesh mesh = meshed({2, 2, 1}, 40,
                           [](const Vector3d& p) { return std::hypot(std::hypot(p.x(), p.y()) - 0.65, p.z()) - 0.25; });
  const Measures m = measure(mesh);
  CHECK(m.closed);
  CHECK(m.euler(mesh.vertex_count(), mesh.triangle_count()) == 0);
  CHECK(m.volume == doctest::Approx(2 * kPi * kPi * 0.65 * 0.0625).epsilon(0.02));
}

TEST_CASE("noise, exact zeros, NaN and a surface that leaves the grid: closed, no triangle without an area") {
  std::mt19937 random(7);
  const Vector3d size(1, 1.2, 0.8);  // more than two blocks of nodes along each axis
  const Measures noise = measure(meshed(4 * size, 36, [&](const Vector3d&) {
    const float values[] = {-1, -1e-7f, 0, 1e-7f, 1, std::numeric_limits<float>::quiet_NaN(), -0.5f};
    return values[random() % 7];
  }));
  CHECK(noise.edges > 50000);
  CHECK(noise.closed);
  CHECK(noise.least_area > 1e-9);

  const Measures solid = measure(meshed(size, 9, [](const Vector3d&) { return -1; }));
  CHECK(solid.closed);  // by the grid's rim
  CHECK(solid.volume > 0.5);
  CHECK(meshed(size, 9, [](const Vector3d&) { return 1; }).triangle_count() == 0);
}

TEST_CASE("blocks that are known to be empty are not asked for, and the mesh is the same") {
  const NodeGrid grid = grid_over(box_of({2, 2, 2}), 100);
  const Implicit all = implicit(sphere(0.9));
  std::size_t asked = 0, most = 0;
  Implicit counted{[&](const std::vector<float>& points) {
    asked += points.size() / 3, most = std::max(most, points.size() / 3);
    return all.values(points);
  }};
  const Mesh whole = isosurface(grid, counted);
  CHECK(asked == grid.node_count());  // each node once
  CHECK(most < 80000);
  asked = 0;
  counted.is_empty = [](const Eigen::AlignedBox3d& box) { return box.exteriorDistance(Vector3d::Zero()) > 0.95; };
  const Mesh parts = isosurface(grid, counted);
  CHECK(asked < grid.node_count() * 9 / 10);
  CHECK(parts.positions == whole.positions);
  CHECK(parts.triangles == whole.triangles);
}

TEST_CASE("the mesh of a radiance field: where its density has the level, closed, coloured as seen from outside") {
  const Vector3d centre(3, -1, 2);
  constexpr double kRadius = 0.7, kLevel = 40, kSteep = 12;
  DensityField ball;
  ball.densities =
      implicit([&](const Vector3d& p) { return kLevel * std::exp(kSteep * (kRadius - (p - centre).norm())); }).values;
  ball.colours = [](const std::vector<float>&, const std::vector<float>& directions) {
    std::vector<float> colours;
    for (const float value : directions) colours.push_back(0.5f - 0.5f * value);
    return colours;
  };
  ball.is_empty = [](const Eigen::AlignedBox3d&) { return false; };
  const Eigen::AlignedBox3d bounds(centre - Vector3d::Ones(), centre + Vector3d::Ones());
  for (const double level : {kLevel, 2 * kLevel}) {
    const double radius = kRadius - std::log(level / kLevel) / kSteep;
    const Mesh mesh = density_mesh(ball, {bounds, 32, level});
    const Measures m = measure(mesh);
    CHECK(m.closed);
    CHECK(m.volume == doctest::Approx(4.0 / 3 * kPi * std::pow(radius, 3)).epsilon(0.01));  // positive: outwards
    REQUIRE(mesh.colours.size() == mesh.positions.size());
    double worst = 0;
    for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
      const Vector3d from = row(mesh.positions, v) - centre;
      worst = std::max(worst, std::abs(from.norm() - radius));
      CHECK((row(mesh.colours, v) - (0.5 * from.normalized() + Vector3d::Constant(0.5))).norm() < 0.15);
    }
    CHECK(worst < 0.05 * 2.0 / 32);  // of a cell
  }
  CHECK(usual_level(bounds) == doctest::Approx(std::log(2) * 128));  // a 128th of a unit takes half of the light
}

TEST_CASE("loose parts of a mesh: the small ones go, whole, and the rest keeps its values") {
  const auto two = [](const Vector3d& p) {
    return std::min((p - Vector3d(0.4, 0, 0)).norm() - 0.5, (p + Vector3d(0.7, 0, 0)).norm() - 0.15);
  };
  Mesh mesh = meshed({2, 2, 2}, 40, two);
  mesh.colours = mesh.positions;
  Mesh same = mesh;
  CHECK(drop_small_parts(same, 0) == 0);
  CHECK(drop_small_parts(same, 0.05) == 0);  // the small ball has 0.15^2 / (0.5^2 + 0.15^2) = 8 % of the area
  CHECK(same.triangles == mesh.triangles);
  CHECK(drop_small_parts(mesh, 0.1) == 1);
  CHECK(mesh.vertex_count() < same.vertex_count());
  CHECK(mesh.colours == mesh.positions);
  CHECK(mesh.normals.size() == mesh.positions.size());
  const Measures m = measure(mesh);
  CHECK(m.closed);
  CHECK(m.volume == doctest::Approx(4.0 / 3 * kPi * 0.125).epsilon(0.01));
  for (std::size_t v = 0; v < mesh.vertex_count(); ++v) CHECK(row(mesh.positions, v).x() > -0.2);
  Mesh last = same;
  CHECK(drop_small_parts(last, 1) == 1);  // the largest stays
}

TEST_CASE("a GLB file by the specification: chunks, extents, axes, linear colours") {
  const Folder folder;
  const Mesh mesh = coloured_sphere();
  const MeshLabel label{"car \"7\"", {{"seed", 42}}};
  write_glb(folder.path / "a.glb", mesh, label);
  write_glb(folder.path / "b.glb", mesh, label);
  const std::string bytes = content_of(folder.path / "a.glb");
  CHECK(bytes == content_of(folder.path / "b.glb"));

  CHECK(bytes.substr(0, 4) == "glTF");
  CHECK(value_at<std::uint32_t>(bytes, 4) == 2);
  CHECK(value_at<std::uint32_t>(bytes, 8) == bytes.size());
  const std::size_t json_length = value_at<std::uint32_t>(bytes, 12);
  CHECK(json_length % 4 == 0);
  CHECK(bytes.substr(16, 4) == "JSON");
  const auto json = nlohmann::json::parse(bytes.substr(20, json_length));
  const std::size_t bin = 20 + json_length + 8;
  CHECK(value_at<std::uint32_t>(bytes, bin - 8) == bytes.size() - bin);
  CHECK(bytes.substr(bin - 4, 4) == std::string("BIN\0", 4));
  CHECK(json["asset"]["version"] == "2.0");
  CHECK(json["asset"]["extras"]["seed"] == 42);
  CHECK(json["nodes"][0]["name"] == "car \"7\"");
  CHECK(json["buffers"][0]["byteLength"] == bytes.size() - bin);

  const auto& primitive = json["meshes"][0]["primitives"][0];
  const auto offset_of = [&](const nlohmann::json& which, int type, const char* shape) {
    const auto& accessor = json["accessors"][which.get<std::size_t>()];
    CHECK(accessor["componentType"] == type);
    CHECK(accessor["type"] == shape);
    const auto& view = json["bufferViews"][accessor["bufferView"].get<std::size_t>()];
    CHECK(view["byteLength"] == accessor["count"].get<std::size_t>() * 4 * (std::string(shape) == "VEC3" ? 3 : 1));
    return bin + view["byteOffset"].get<std::size_t>();
  };
  const auto& attributes = primitive["attributes"];
  const std::size_t vertices = mesh.vertex_count(), indices = mesh.triangles.size();
  CHECK(json["accessors"][attributes["POSITION"].get<std::size_t>()]["count"] == vertices);
  CHECK(json["accessors"][primitive["indices"].get<std::size_t>()]["count"] == indices);
  const auto positions = values_at<float>(bytes, offset_of(attributes["POSITION"], 5126, "VEC3"), 3 * vertices);
  const auto normals = values_at<float>(bytes, offset_of(attributes["NORMAL"], 5126, "VEC3"), 3 * vertices);
  const auto colours = values_at<float>(bytes, offset_of(attributes["COLOR_0"], 5126, "VEC3"), 3 * vertices);
  const auto triangles = values_at<std::uint32_t>(bytes, offset_of(primitive["indices"], 5125, "SCALAR"), indices);

  const Measures m = measure(positions, triangles);
  CHECK(m.closed);
  CHECK(m.volume == doctest::Approx(4.0 / 3 * kPi * 0.512).epsilon(0.02));  // a mirrored file would be negative
  Vector3d least = Vector3d::Constant(1e9), most = -least, forward = Vector3d::Zero();
  for (std::size_t v = 0; v < vertices; ++v) {
    const Vector3d p = row(positions, v);
    least = least.cwiseMin(p);
    most = most.cwiseMax(p);
    forward += p / double(vertices);
    CHECK(row(normals, v).dot((p - Vector3d(0, 0, 1)).normalized()) > 0.9);
    const Vector3d colour = row(colours, v);  // 0.5 of sRGB is 0.2140 of the light
    CHECK((colour - (p.x() < 0 ? Vector3d(1, 0, 0) : Vector3d(0, 0.21404, 0))).norm() < 1e-4);
  }
  CHECK(forward.z() == doctest::Approx(1).epsilon(0.01));  // the box's y
  const auto& extents = json["accessors"][attributes["POSITION"].get<std::size_t>()];
  for (int axis = 0; axis < 3; ++axis) {
    CHECK(extents["min"][std::size_t(axis)].get<float>() == float(least[axis]));
    CHECK(extents["max"][std::size_t(axis)].get<float>() == float(most[axis]));
  }
  CHECK_THROWS_AS(write_glb(folder.path / "none.glb", Mesh{}, label), Error);
}

TEST_CASE("a PLY file holds what its head says") {
  const Folder folder;
  const Mesh mesh = coloured_sphere();
  write_ply(folder.path / "a.ply", mesh, {"car\nelement vertex 7", {}});
  const std::string bytes = content_of(folder.path / "a.ply");
  const std::size_t body = bytes.find("end_header\n") + 11;
  std::istringstream head(bytes.substr(0, body));
  std::size_t vertices = 0, faces = 0;
  for (std::string line; std::getline(head, line);) {
    std::sscanf(line.c_str(), "element vertex %zu", &vertices);
    std::sscanf(line.c_str(), "element face %zu", &faces);
  }
  CHECK(vertices == mesh.vertex_count());
  CHECK(faces == mesh.triangle_count());
  REQUIRE(bytes.size() == body + 27 * vertices + 13 * faces);
  for (const std::size_t v : {std::size_t{0}, vertices / 2, vertices - 1}) {
    const std::size_t at = body + 27 * v;
    CHECK(value_at<float>(bytes, at + 4) == mesh.positions[3 * v + 1]);
    CHECK(value_at<float>(bytes, at + 20) == mesh.normals[3 * v + 2]);
    CHECK(value_at<std::uint8_t>(bytes, at + 25) == (mesh.positions[3 * v] > 0 ? 0 : 128));
  }
  const std::size_t last = bytes.size() - 13;
  CHECK(bytes[last] == 3);
  CHECK(value_at<std::uint32_t>(bytes, last + 9) == mesh.triangles.back());
}

TEST_CASE("the mesh of an asset: volume and colours of its box") {
  Scene log;
  log.actors = {{"truck", "Truck", {2.5, 7, 3}, true, {}}};
  AnalyticStreet street({log});
  const Mesh mesh = asset_mesh(street, {0, "truck"}, log.actors[0].size, 60);
  const Measures m = measure(mesh);
  CHECK(m.closed);
  CHECK(m.volume == doctest::Approx(2.5 * 7 * 3).epsilon(0.02));
  REQUIRE(mesh.colours.size() == mesh.positions.size());
  for (std::size_t v = 0; v < mesh.positions.size(); v += 3) {
    CHECK(mesh.colours[v] == (mesh.positions[v] > 0 ? 1.f : 0.f));
  }
}
