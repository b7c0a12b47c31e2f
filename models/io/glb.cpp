// See glb.h.
#include "models/io/glb.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>

#include "models/io/bytes.h"
#include "models/io/commit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Document = nlohmann::ordered_json;

constexpr int kVertices = 34962, kIndices = 34963;
constexpr std::uint32_t kMagic = 0x46546C67, kJsonChunk = 0x4E4F534A, kBinChunk = 0x004E4942;  // "glTF" "JSON" "BIN"
constexpr std::uint64_t kMaxBytes = std::numeric_limits<std::uint32_t>::max();

std::size_t components(const std::string& shape) {
  return shape == "SCALAR" ? 1 : static_cast<std::size_t>(shape.back() - '0');
}

std::uint32_t padded(std::uint64_t size) { return static_cast<std::uint32_t>((size + 3) / 4 * 4); }

template <class Part>
std::span<const std::byte> as_part(const Part& part) {
  return std::as_bytes(std::span(part));
}

}  // namespace

template <class Value>
int GlbBuffer::add(std::span<const Value> values, int type, const char* shape, int target) {
  views_.push_back(
      {{"buffer", 0}, {"byteOffset", bytes_.size()}, {"byteLength", values.size_bytes()}, {"target", target}});
  accessors_.push_back({{"bufferView", views_.size() - 1},
                        {"componentType", type},
                        {"count", values.size() / components(shape)},
                        {"type", shape}});
  bytes_.append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
  return static_cast<int>(accessors_.size()) - 1;
}

int GlbBuffer::add_vertices(std::span<const float> values, const char* shape) {
  return add(values, gltf::kFloat, shape, kVertices);
}

int GlbBuffer::add_positions(std::span<const float> positions) {
  constexpr float kFar = std::numeric_limits<float>::max();
  std::array<float, 3> least{kFar, kFar, kFar}, most{-kFar, -kFar, -kFar};
  for (std::size_t i = 0; i < positions.size(); ++i) {
    least[i % 3] = std::min(least[i % 3], positions[i]);
    most[i % 3] = std::max(most[i % 3], positions[i]);
  }
  const int accessor = add_vertices(positions, "VEC3");
  accessors_.back()["min"] = least;
  accessors_.back()["max"] = most;
  return accessor;
}

int GlbBuffer::add_indices(std::span<const std::uint32_t> values) {
  return add(values, gltf::kUnsignedInt, "SCALAR", kIndices);
}

int GlbBuffer::add_colours(std::span<const std::uint8_t> rgba) {
  const int accessor = add(rgba, gltf::kUnsignedByte, "VEC4", kVertices);
  accessors_.back()["normalized"] = true;
  return accessor;
}

void GlbBuffer::write(const std::filesystem::path& path, Document document) const {
  document["accessors"] = accessors_;
  document["bufferViews"] = views_;
  document["buffers"] = {{{"byteLength", bytes_.size()}}};
  std::string json = document.dump(-1, ' ', false, Document::error_handler_t::replace);
  json.resize(padded(json.size()), ' ');
  const std::uint64_t size = 12 + 8 + json.size() + 8 + std::uint64_t{bytes_.size()} + 3;
  if (size > kMaxBytes) bad_data(path.string(), ": ", bytes_.size(), " bytes are more than a GLB can hold (4 GiB)");
  const std::uint32_t bin_size = padded(bytes_.size()), json_size = padded(json.size());
  const std::array<std::uint32_t, 5> start{kMagic, 2, 12 + 8 + json_size + 8 + bin_size, json_size, kJsonChunk};
  const std::array<std::uint32_t, 2> bin{bin_size, kBinChunk};
  const std::string filler(bin_size - bytes_.size(), '\0');
  const std::span<const std::byte> parts[] = {as_part(start), as_part(json), as_part(bin), as_part(bytes_),
                                              as_part(filler)};
  commit_bytes(path, parts);
}

GlbChunks read_glb_chunks(const std::filesystem::path& path) {
  const auto bytes = read_file(path, kMaxBytes);
  const auto fail = [&](const std::string& why) { bad_data(path.string() + ": " + why); };
  ByteReader reader(bytes, path.string());
  if (reader.little<std::uint32_t>("the GLB header") != kMagic) fail("is not a GLB file: it does not begin with glTF");
  const auto version = reader.little<std::uint32_t>("the GLB header");
  if (version != 2) fail(text("is glTF of version ", version, ", want 2"));
  const auto size = reader.little<std::uint32_t>("the GLB header");
  if (size != bytes.size()) {
    fail(text("holds ", bytes.size(), " bytes, its header says ", size, "; it is damaged or truncated"));
  }
  GlbChunks chunks;
  for (int index = 0; reader.remaining() > 0; ++index) {
    const auto length = reader.little<std::uint32_t>("the head of a chunk");
    const auto type = reader.little<std::uint32_t>("the head of a chunk");
    const auto content = reader.take(length, "a chunk");
    if (index == 0 && type == kJsonChunk) chunks.json.assign(content.begin(), content.end());
    if (index == 1 && type == kBinChunk) chunks.content.assign(content.begin(), content.end());
  }
  if (chunks.json.empty()) fail("has no JSON chunk");
  return chunks;
}

}  // namespace cloam
