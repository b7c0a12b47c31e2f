// glTF 2.0 specification, Khronos Group, 2021: section 3.7 (meshes).
#include "models/mesh/write_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "models/io/commit.h"
#include "models/io/glb.h"
#include "models/io/srgb.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Document = nlohmann::ordered_json;

void check(const std::filesystem::path& path, const Mesh& mesh) {
  if (mesh.triangle_count() == 0) bad_data(path.string(), ": a mesh without triangles");
  const std::uint64_t bytes = 36 * std::uint64_t{mesh.vertex_count()} + 12 * std::uint64_t{mesh.triangle_count()};
  if (bytes > std::numeric_limits<std::uint32_t>::max() / 2)
    bad_data(path.string(), ": a mesh of ", bytes, " bytes is too large; lower the resolution");
}

std::vector<float> turned(const std::vector<float>& values, const Eigen::Matrix3d& rotation) {
  std::vector<float> out;
  out.reserve(values.size());
  for (std::size_t i = 0; i < values.size(); i += 3) {
    const Eigen::Vector3f at = (rotation * Eigen::Vector3d(values[i], values[i + 1], values[i + 2])).cast<float>();
    out.insert(out.end(), at.data(), at.data() + 3);
  }
  return out;
}

/// What a comment says of how the mesh was made, in one line.
std::string made(const MeshLabel& label) {
  return Document({{"name", label.name}, {"made", label.extras}})
      .dump(-1, ' ', true, Document::error_handler_t::replace);
}

template <class Value>
void append(std::string& bytes, const Value* values, std::size_t count) {
  bytes.append(reinterpret_cast<const char*>(values), count * sizeof(Value));
}

Document document(const Mesh& mesh, const MeshLabel& label, GlbBuffer& buffer) {
  std::vector<float> colours(mesh.colours.size());
  std::transform(mesh.colours.begin(), mesh.colours.end(), colours.begin(), linear_colour);
  const Document attributes = {{"POSITION", buffer.add_positions(turned(mesh.positions, label.gltf_from_mesh))},
                               {"NORMAL", buffer.add_vertices(turned(mesh.normals, label.gltf_from_mesh), "VEC3")},
                               {"COLOR_0", buffer.add_vertices(colours, "VEC3")}};
  const Document primitive = {
      {"attributes", attributes}, {"indices", buffer.add_indices(mesh.triangles)}, {"material", 0}, {"mode", 4}};
  const Document surface = {{"baseColorFactor", {1, 1, 1, 1}}, {"metallicFactor", 0}, {"roughnessFactor", 1}};
  return {{"asset", {{"version", "2.0"}, {"generator", "cloam"}, {"extras", label.extras}}},
          {"extensionsUsed", {"KHR_materials_unlit"}},
          {"scene", 0},
          {"scenes", {{{"nodes", {0}}}}},
          {"nodes", {{{"name", label.name}, {"mesh", 0}}}},
          {"meshes", {{{"name", label.name}, {"primitives", {primitive}}}}},
          {"materials",
           {{{"pbrMetallicRoughness", surface}, {"extensions", {{"KHR_materials_unlit", Document::object()}}}}}}};
}

/// The header, whose end tells of what follows the vertices, and the vertices.
std::string ply_vertices(const Mesh& mesh, const MeshLabel& label, const std::string& after) {
  std::string bytes = text("ply\nformat binary_little_endian 1.0\ncomment ", made(label), "\ncomment ", label.axes);
  bytes += text("\nelement vertex ", mesh.vertex_count(), "\n");
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz"}) bytes += text("property float ", name, "\n");
  for (const char* name : {"red", "green", "blue"}) bytes += text("property uchar ", name, "\n");
  bytes += after + "end_header\n";
  for (std::size_t i = 0; i < mesh.positions.size(); i += 3) {
    append(bytes, &mesh.positions[i], 3);
    append(bytes, &mesh.normals[i], 3);
    for (std::size_t c = i; c < i + 3; ++c) {
      bytes.push_back(static_cast<char>(std::lround(255 * std::clamp(mesh.colours[c], 0.f, 1.f))));
    }
  }
  return bytes;
}

}  // namespace

void write_glb(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label) {
  check(path, mesh);
  GlbBuffer buffer;
  const Document json = document(mesh, label, buffer);
  buffer.write(path, json);
}

void write_ply(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label) {
  check(path, mesh);
  std::string bytes = ply_vertices(
      mesh, label, text("element face ", mesh.triangle_count(), "\nproperty list uchar uint vertex_indices\n"));
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3) {
    bytes.push_back(3);
    append(bytes, &mesh.triangles[t], 3);
  }
  commit_text(path, bytes);
}

void write_points(const std::filesystem::path& path, const Mesh& points, const MeshLabel& label) {
  commit_text(path, ply_vertices(points, label, ""));
}

void write_obj(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label) {
  check(path, mesh);
  std::string lines = text("# ", made(label), "\n# ", label.axes, "\n");
  for (std::size_t i = 0; i < mesh.positions.size(); i += 3) {
    const float *p = &mesh.positions[i], *c = &mesh.colours[i];
    fmt::format_to(std::back_inserter(lines), "v {} {} {} {:.4g} {:.4g} {:.4g}\n", p[0], p[1], p[2], c[0], c[1], c[2]);
  }
  for (std::size_t i = 0; i < mesh.normals.size(); i += 3) {
    const float* n = &mesh.normals[i];
    fmt::format_to(std::back_inserter(lines), "vn {:.4g} {:.4g} {:.4g}\n", n[0], n[1], n[2]);
  }
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3) {
    const std::uint32_t a = mesh.triangles[t] + 1, b = mesh.triangles[t + 1] + 1, c = mesh.triangles[t + 2] + 1;
    fmt::format_to(std::back_inserter(lines), "f {}//{} {}//{} {}//{}\n", a, a, b, b, c, c);
  }
  commit_text(path, lines);
}

void write_mesh(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label) {
  const std::string extension = lower_case(path.extension().string());
  (extension == ".obj" ? write_obj : extension == ".ply" ? write_ply : write_glb)(path, mesh, label);
}

}  // namespace cloam
