// Mesh files as another program reads them: Debian's assimp dumps what it found.
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <sstream>

#include "models/mesh/isosurface.h"
#include "models/mesh/write_mesh.h"
#include "tests/models/folder.h"

using namespace cloam;
using Eigen::Vector3d;
namespace fs = std::filesystem;

namespace {

/// The numbers between `<TAG num="N" ...>` and its end, the first time that the tag stands there.
std::vector<double> numbers_of(const std::string& dump, const std::string& tag) {
  const std::size_t begin = dump.find(">", dump.find("<" + tag + " num=")) + 1;
  std::istringstream in(dump.substr(begin, dump.find("</" + tag + ">", begin) - begin));
  std::vector<double> numbers;
  for (double number; in >> number;) numbers.push_back(number);
  return numbers;
}

/// What assimp makes of a file: a corner of a triangle after the other, as the reader may have split vertices.
struct Corners {
  std::vector<Vector3d> positions, normals, colours;
};

Corners read_by_assimp(const fs::path& file) {
  const fs::path dump_file = file.string() + ".assxml";
  REQUIRE(std::system(("assimp dump " + file.string() + " " + dump_file.string() + " >/dev/null 2>&1").c_str()) == 0);
  const std::string dump = content_of(dump_file);
  const std::vector<double> positions = numbers_of(dump, "Positions"), normals = numbers_of(dump, "Normals"),
                            colours = numbers_of(dump, "Colors");
  REQUIRE(normals.size() == positions.size());
  const std::size_t channels = 3 * colours.size() / positions.size();
  REQUIRE((channels == 3 || channels == 4));
  Corners corners;
  for (std::size_t at = dump.find("<Face num=\"3\">"); at != std::string::npos; at = dump.find("<Face num=", at + 1)) {
    std::istringstream in(dump.substr(at + 14, 64));
    for (std::size_t i = 0, v = 0; i < 3 && in >> v; ++i) {
      REQUIRE(3 * v + 2 < positions.size());
      corners.positions.emplace_back(positions[3 * v], positions[3 * v + 1], positions[3 * v + 2]);
      corners.normals.emplace_back(normals[3 * v], normals[3 * v + 1], normals[3 * v + 2]);
      const double* colour = &colours[channels * v];
      corners.colours.emplace_back(colour[0], colour[1], colour[2]);
    }
  }
  return corners;
}

/// An egg that lies aside; colours follow the place.
Mesh egg() {
  const auto values = [](const std::vector<float>& points) {
    std::vector<float> out;
    for (std::size_t i = 0; i < points.size(); i += 3)
      out.push_back(Vector3d(points[i] - 2, 1.5 * points[i + 1], points[i + 2] + points[i + 1] / 3).norm() - 0.7);
    return out;
  };
  Mesh mesh = isosurface(grid_over({Vector3d(1, -1, -1.2), Vector3d(3, 1, 1.2)}, 14), {values});
  for (std::size_t i = 0; i < mesh.positions.size(); i += 3)
    for (const float share : {mesh.positions[i] - 1, mesh.positions[i + 1] + 1, mesh.positions[i + 2] + 1.2f})
      mesh.colours.push_back(share / 2.4f);
  return mesh;
}

double linear(double srgb) { return srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4); }

}  // namespace

TEST_CASE("glb, obj and ply: assimp reads every triangle where it was written, with its normals and colours") {
  if (std::system("command -v assimp >/dev/null 2>&1") != 0) {
    MESSAGE("skipped: no assimp (apt-get install assimp-utils)");
    return;
  }
  const Folder folder;
  const Mesh mesh = egg();
  MeshLabel label{"egg\nv 1 2 3", {{"seed", 42}}};
  label.gltf_from_mesh = Eigen::AngleAxisd(-1.5707963267948966, Vector3d::UnitX()).toRotationMatrix();  // z up to y up
  for (const char* extension : kMeshExtensions) {
    CAPTURE(extension);
    const fs::path file = folder.path / (std::string("egg") + extension);
    write_mesh(file, mesh, label);
    const Corners read = read_by_assimp(file);
    REQUIRE(read.positions.size() == mesh.triangles.size());
    const bool is_glb = std::string(extension) == ".glb";
    double position = 0, normal = 0, colour = 0;  // largest differences
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      const auto of_mesh = [&](const std::vector<float>& values) {
        const float* at = &values[3 * std::size_t(mesh.triangles[i])];
        return Vector3d(at[0], at[1], at[2]);
      };
      const auto moved = [&](const Vector3d& at) { return is_glb ? Vector3d(at.x(), at.z(), -at.y()) : at; };
      const Vector3d paint = of_mesh(mesh.colours), shown = is_glb ? Vector3d(paint.unaryExpr(&linear)) : paint;
      position = std::max(position, (read.positions[i] - moved(of_mesh(mesh.positions))).norm());
      normal = std::max(normal, (read.normals[i] - moved(of_mesh(mesh.normals))).norm());
      colour = std::max(colour, (read.colours[i] - shown).cwiseAbs().maxCoeff());
    }
    CHECK(position < 2e-6);  // assimp dumps six decimals
    CHECK(normal < 2e-4);
    CHECK(colour < (std::string(extension) == ".ply" ? 0.51 / 255 : 1e-4));
  }
}
