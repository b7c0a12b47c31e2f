// glTF 2.0 specification, Khronos Group, 2021: section 3.7 (meshes).
#include "models/mesh/write_mesh.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "models/io/commit.h"
#include "models/io/glb.h"
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

/// From x right, y forward, z up to x left, y up, z forward.
std::vector<float> gltf_axes(const std::vector<float>& values) {
  std::vector<float> turned(values.size());
  for (std::size_t i = 0; i < values.size(); i += 3) {
    turned[i] = -values[i];
    turned[i + 1] = values[i + 2];
    turned[i + 2] = values[i + 1];
  }
  return turned;
}

template <class Value>
void append(std::string& bytes, const Value* values, std::size_t count) {
  bytes.append(reinterpret_cast<const char*>(values), count * sizeof(Value));
}

Document document(const Mesh& mesh, const MeshLabel& label, GlbBuffer& buffer) {
  std::vector<float> colours(mesh.colours.size());
  std::transform(mesh.colours.begin(), mesh.colours.end(), colours.begin(), linear_colour);
  const Document attributes = {{"POSITION", buffer.add_positions(gltf_axes(mesh.positions))},
                               {"NORMAL", buffer.add_vertices(gltf_axes(mesh.normals), "VEC3")},
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

}  // namespace

void write_glb(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label) {
  check(path, mesh);
  GlbBuffer buffer;
  const Document json = document(mesh, label, buffer);
  buffer.write(path, json);
}

void write_ply(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label) {
  check(path, mesh);
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\ncomment " +
      Document({{"name", label.name}, {"made", label.extras}}).dump(-1, ' ', true, Document::error_handler_t::replace) +
      "\ncomment x right, y forward, z up; metres";
  bytes += text("\nelement vertex ", mesh.vertex_count());
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz"}) bytes += text("\nproperty float ", name);
  for (const char* name : {"red", "green", "blue"}) bytes += text("\nproperty uchar ", name);
  bytes += text("\nelement face ", mesh.triangle_count(), "\nproperty list uchar uint vertex_indices\nend_header\n");
  for (std::size_t i = 0; i < mesh.positions.size(); i += 3) {
    append(bytes, &mesh.positions[i], 3);
    append(bytes, &mesh.normals[i], 3);
    for (std::size_t c = i; c < i + 3; ++c) {
      bytes.push_back(static_cast<char>(std::lround(255 * std::clamp(mesh.colours[c], 0.f, 1.f))));
    }
  }
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3) {
    bytes.push_back(3);
    append(bytes, &mesh.triangles[t], 3);
  }
  commit_text(path, bytes);
}

}  // namespace cloam
