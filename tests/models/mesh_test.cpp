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

#include "models/mesh/isosurface.h"
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

DistanceGrid sampled(const Vector3d& size, int resolution, const Distance& distance) {
  DistanceGrid grid = grid_over(size, resolution);
  for (std::size_t n = 0; n < grid.node_count(); ++n) {
    grid.distances.push_back(static_cast<float>(distance(grid.position(n))));
  }
  return grid;
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
  Mesh mesh =
      isosurface(sampled({2, 4, 2}, 24, [](const Vector3d& p) { return (p - Vector3d(0, 1, 0)).norm() - 0.8; }));
  for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
    const bool right = mesh.positions[3 * v] > 0;
    mesh.colours.insert(mesh.colours.end(), {right ? 1.f : 0.f, right ? 0.f : 0.5f, 0.f});
  }
  return mesh;
}

}  // namespace

TEST_CASE("a grid covers the box and a tenth more with cubes") {
  const DistanceGrid grid = grid_over({2, 5, 1.5}, 50);
  CHECK(grid.spacing == doctest::Approx(0.11));
  CHECK(grid.counts[1] == 51);
  const Vector3d first = grid.position(0), last = grid.position(grid.node_count() - 1);
  CHECK((first + last).norm() < 1e-12);
  CHECK(last.y() == doctest::Approx(2.75));
  CHECK(last.x() >= 1.1);
  CHECK(last.z() < 0.825 + 0.11);
}

TEST_CASE("a sphere's surface: area, volume and normals of the closed form, closed and of genus 0") {
  const Mesh mesh = isosurface(sampled({2, 2, 2}, 40, sphere(0.9)));
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
  const Mesh mesh = isosurface(sampled(
      {2, 2, 1}, 40, [](const Vector3d& p) { return std::hypot(std::hypot(p.x(), p.y()) - 0.65, p.z()) - 0.25; }));
  const Measures m = measure(mesh);
  CHECK(m.closed);
  CHECK(m.euler(mesh.vertex_count(), mesh.triangle_count()) == 0);
  CHECK(m.volume == doctest::Approx(2 * kPi * kPi * 0.65 * 0.0625).epsilon(0.02));
}

TEST_CASE("noise, exact zeros, NaN and a surface that leaves the grid: closed, no triangle without an area") {
  std::mt19937 random(7);
  DistanceGrid grid = grid_over({1, 1.2, 0.8}, 9);
  for (std::size_t n = 0; n < grid.node_count(); ++n) {
    const float values[] = {-1, -1e-7f, 0, 1e-7f, 1, std::numeric_limits<float>::quiet_NaN(), -0.5f};
    grid.distances.push_back(values[random() % 7]);
  }
  const Measures noise = measure(isosurface(grid));
  CHECK(noise.edges > 1000);
  CHECK(noise.closed);
  CHECK(noise.least_area > 1e-9);

  std::fill(grid.distances.begin(), grid.distances.end(), -1.f);  // solid throughout: the grid's rim closes it
  const Measures solid = measure(isosurface(grid));
  CHECK(solid.closed);
  CHECK(solid.volume > 0.5);
  std::fill(grid.distances.begin(), grid.distances.end(), 1.f);
  CHECK(isosurface(grid).triangle_count() == 0);
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
