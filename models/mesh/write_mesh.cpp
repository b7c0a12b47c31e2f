// glTF 2.0 specification, Khronos Group, 2021: sections 3.6 (buffers), 3.7 (meshes), 4.4 (the GLB container).
#include "models/mesh/write_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <span>

#include "models/io/commit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Json = nlohmann::ordered_json;

// Numbers of the specification.
constexpr int kFloat = 5126, kUnsignedInt = 5125;
constexpr int kVertices = 34962, kIndices = 34963;
constexpr std::uint32_t kMagic = 0x46546C67, kJsonChunk = 0x4E4F534A, kBinChunk = 0x004E4942;  // "glTF" "JSON" "BIN"

void check(const std::filesystem::path& path, const Mesh& mesh) {
  if (mesh.triangle_count() == 0) throw Error(Fault::data, text(path.string(), ": a mesh without triangles"));
  const std::uint64_t bytes = 36 * std::uint64_t{mesh.vertex_count()} + 12 * std::uint64_t{mesh.triangle_count()};
  if (bytes > std::numeric_limits<std::uint32_t>::max() / 2) {
    throw Error(Fault::data, text(path.string(), ": a mesh of ", bytes, " bytes is too large; lower the resolution"));
  }
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

/// The inverse of the sRGB curve (IEC 61966-2-1): COLOR_0 is linear.
float linear(float srgb) {
  const float value = std::clamp(srgb, 0.f, 1.f);
  return value <= 0.04045f ? value / 12.92f : std::pow((value + 0.055f) / 1.055f, 2.4f);
}

struct Bounds {
  std::array<float, 3> least, most;
};

Bounds bounds_of(const std::vector<float>& positions) {
  constexpr float kFar = std::numeric_limits<float>::max();
  Bounds bounds{{kFar, kFar, kFar}, {-kFar, -kFar, -kFar}};
  for (std::size_t i = 0; i < positions.size(); ++i) {
    bounds.least[i % 3] = std::min(bounds.least[i % 3], positions[i]);
    bounds.most[i % 3] = std::max(bounds.most[i % 3], positions[i]);
  }
  return bounds;
}

template <class Value>
void append(std::string& bytes, const Value* values, std::size_t count) {
  bytes.append(reinterpret_cast<const char*>(values), count * sizeof(Value));
}

/// The one buffer of the file, and the views into it.
struct Buffer {
  std::string bytes;
  Json views = Json::array();

  template <class Value>
  void add(const std::vector<Value>& values, int target) {
    const std::size_t length = values.size() * sizeof(Value);
    views.push_back({{"buffer", 0}, {"byteOffset", bytes.size()}, {"byteLength", length}, {"target", target}});
    append(bytes, values.data(), values.size());
  }
};

Json accessor(int view, int type, std::size_t count, const char* shape) {
  return {{"bufferView", view}, {"componentType", type}, {"count", count}, {"type", shape}};
}

Json document(const Mesh& mesh, const MeshLabel& label, const Buffer& buffer, const Bounds& bounds) {
  const std::size_t vertices = mesh.vertex_count();
  Json positions = accessor(0, kFloat, vertices, "VEC3");
  positions["min"] = bounds.least;
  positions["max"] = bounds.most;
  const Json primitive = {
      {"attributes", {{"POSITION", 0}, {"NORMAL", 1}, {"COLOR_0", 2}}}, {"indices", 3}, {"material", 0}, {"mode", 4}};
  const Json surface = {{"baseColorFactor", {1, 1, 1, 1}}, {"metallicFactor", 0}, {"roughnessFactor", 1}};
  return {
      {"asset", {{"version", "2.0"}, {"generator", "cloam"}, {"extras", label.extras}}},
      {"extensionsUsed", {"KHR_materials_unlit"}},
      {"scene", 0},
      {"scenes", {{{"nodes", {0}}}}},
      {"nodes", {{{"name", label.name}, {"mesh", 0}}}},
      {"meshes", {{{"name", label.name}, {"primitives", {primitive}}}}},
      {"materials", {{{"pbrMetallicRoughness", surface}, {"extensions", {{"KHR_materials_unlit", Json::object()}}}}}},
      {"accessors",
       {positions, accessor(1, kFloat, vertices, "VEC3"), accessor(2, kFloat, vertices, "VEC3"),
        accessor(3, kUnsignedInt, mesh.triangles.size(), "SCALAR")}},
      {"bufferViews", buffer.views},
      {"buffers", {{{"byteLength", buffer.bytes.size()}}}}};
}

std::string chunk(std::uint32_t type, std::string content, char filler) {
  content.resize((content.size() + 3) / 4 * 4, filler);
  const std::uint32_t head[] = {static_cast<std::uint32_t>(content.size()), type};
  std::string bytes;
  append(bytes, head, 2);
  return bytes + content;
}

}  // namespace

void write_glb(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label) {
  check(path, mesh);
  const std::vector<float> positions = gltf_axes(mesh.positions);
  std::vector<float> colours(mesh.colours.size());
  std::transform(mesh.colours.begin(), mesh.colours.end(), colours.begin(), linear);
  Buffer buffer;
  buffer.add(positions, kVertices);
  buffer.add(gltf_axes(mesh.normals), kVertices);
  buffer.add(colours, kVertices);
  buffer.add(mesh.triangles, kIndices);
  const Json json = document(mesh, label, buffer, bounds_of(positions));
  const std::string content = chunk(kJsonChunk, json.dump(-1, ' ', false, Json::error_handler_t::replace), ' ') +
                              chunk(kBinChunk, std::move(buffer.bytes), '\0');
  const std::uint32_t head[] = {kMagic, 2, static_cast<std::uint32_t>(12 + content.size())};
  std::string file;
  append(file, head, 3);
  commit_text(path, file + content);
}

void write_ply(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label) {
  check(path, mesh);
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\ncomment " +
      Json({{"name", label.name}, {"made", label.extras}}).dump(-1, ' ', true, Json::error_handler_t::replace) +
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
