// GLB, glTF 2.0 in one binary file: a JSON document and one buffer that its accessors point into.
// glTF 2.0 specification, Khronos Group, 2021: sections 3.6 (buffers) and 4.4 (the GLB container).
#pragma once
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

namespace cloam {

/// Numbers of the specification: the types of an accessor's components.
namespace gltf {
constexpr int kByte = 5120, kUnsignedByte = 5121, kShort = 5122, kUnsignedShort = 5123, kUnsignedInt = 5125,
              kFloat = 5126;
}

/// The one buffer of a file that is being made, with its views and accessors.
class GlbBuffer {
 public:
  /// shape: "SCALAR", "VEC2", "VEC3" or "VEC4". The index of the new accessor.
  int add_vertices(std::span<const float> values, const char* shape);
  /// As add_vertices of VEC3, with the bounds that POSITION must have.
  int add_positions(std::span<const float> positions);
  int add_indices(std::span<const std::uint32_t> values);
  /// Bytes that stand for 0 to 1.
  int add_colours(std::span<const std::uint8_t> rgba);

  /// Completes the document with what was added and writes both. Replaces `path` in one step. Fault::data for more than
  /// the 4 GiB that a GLB can hold; Fault::write.
  void write(const std::filesystem::path& path, nlohmann::ordered_json document) const;

 private:
  template <class Value>
  int add(std::span<const Value> values, int type, const char* shape, int target);

  std::string bytes_;
  nlohmann::ordered_json views_ = nlohmann::ordered_json::array(), accessors_ = nlohmann::ordered_json::array();
};

struct GlbChunks {
  std::string json;                   // not yet parsed
  std::vector<std::uint8_t> content;  // of the buffer; may have up to 3 bytes more than the buffer
};

/// Fault::data for what is no GLB of glTF 2, and for one that is cut short.
GlbChunks read_glb_chunks(const std::filesystem::path& path);

}  // namespace cloam
