// See packed_tensors.h.
#include "models/io/packed_tensors.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <sstream>

#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kPacked[] = "packed", kEntry[] = "packed.";
constexpr char kHalf[] = "half", kZeros[] = "zeros", kAs[] = "as ";

template <class To, class From>
std::vector<std::byte> converted(const std::vector<std::byte>& bytes) {
  std::vector<std::byte> out(bytes.size() / sizeof(From) * sizeof(To));
  for (std::size_t i = 0; i < bytes.size() / sizeof(From); ++i) {
    From from;
    std::memcpy(&from, &bytes[i * sizeof(From)], sizeof(From));
    const To to = static_cast<To>(from);
    std::memcpy(&out[i * sizeof(To)], &to, sizeof(To));
  }
  return out;
}

void halve(const std::string& name, NamedTensor& tensor) {
  if (tensor.dtype != "F32") return;
  std::vector<std::byte> half = converted<Eigen::half, float>(tensor.data);
  for (std::size_t i = 0; i < half.size(); i += sizeof(Eigen::half)) {
    Eigen::half value;
    std::memcpy(&value, &half[i], sizeof(value));
    if (!(Eigen::numext::isfinite)(value))
      bad_data("the tensor ", name, " has values beyond 65504, which half precision cannot hold");
  }
  tensor.dtype = "F16";
  tensor.data = std::move(half);
}

bool all_zero(const NamedTensor& tensor) {
  return std::all_of(tensor.data.begin(), tensor.data.end(), [](std::byte b) { return b == std::byte{0}; });
}

/// "F16 3 4": what zeros stand for.
std::string shape_words(const NamedTensor& tensor) {
  std::string words = tensor.dtype;
  for (const int64_t extent : tensor.shape) words += " " + std::to_string(extent);
  return words;
}

/// Bytes of a tensor, or none where they are more than `most` or the type is unknown.
std::optional<uint64_t> bytes_of(const NamedTensor& tensor, uint64_t most) {
  uint64_t bytes = tensor.dtype == "F16" ? 2 : tensor.dtype == "I32" ? 4 : tensor.dtype == "I64" ? 8 : 0;
  if (bytes == 0) return std::nullopt;
  for (const int64_t extent : tensor.shape) {
    if (extent <= 0 || bytes > most / static_cast<uint64_t>(extent)) return std::nullopt;
    bytes *= static_cast<uint64_t>(extent);
  }
  return bytes;
}

/// What a line of the metadata stands for; `left`: bytes that may still be added.
NamedTensor left_out(const SafetensorsFile& file, const std::string& words, uint64_t& left) {
  NamedTensor tensor;
  if (words.starts_with(kAs)) {
    const auto other = file.tensors.find(words.substr(std::strlen(kAs)));
    if (other == file.tensors.end() || other->second.data.size() > left) return {};
    left -= other->second.data.size();
    return other->second;
  }
  std::istringstream in(words);
  std::string kind;
  in >> kind >> tensor.dtype;
  if (kind != kZeros) return {};
  for (int64_t extent = 0; in >> extent;) tensor.shape.push_back(extent);
  const std::optional<uint64_t> bytes = bytes_of(tensor, left);
  if (!bytes || !in.eof()) return {};
  left -= *bytes;
  tensor.data.assign(*bytes, std::byte{0});
  return tensor;
}

}  // namespace

SafetensorsFile pack(SafetensorsFile file) {
  SafetensorsFile out;
  out.metadata = std::move(file.metadata);
  out.metadata[kPacked] = kHalf;
  for (auto& [name, tensor] : file.tensors) {
    halve(name, tensor);
    const auto same = std::ranges::find(
        out.tensors, tensor, [](const auto& other) -> const auto& { return other.second; });
    if (!tensor.data.empty() && all_zero(tensor))
      out.metadata[kEntry + name] = kZeros + (" " + shape_words(tensor));
    else if (same != out.tensors.end())
      out.metadata[kEntry + name] = kAs + same->first;
    else
      out.tensors[name] = std::move(tensor);
  }
  return out;
}

SafetensorsFile unpack(SafetensorsFile file) {
  const auto packed = file.metadata.find(kPacked);
  if (packed == file.metadata.end()) return file;
  if (packed->second != kHalf)
    bad_data("packed tensors: this version reads \"", kHalf, "\", the file says \"", packed->second.substr(0, 40),
             "\"");
  file.metadata.erase(packed);
  uint64_t left = kMostZeros;
  TensorMap more;
  for (auto at = file.metadata.begin(); at != file.metadata.end();) {
    const auto [key, words] = *at;
    if (!key.starts_with(kEntry)) {
      ++at;
      continue;
    }
    const std::string name = key.substr(std::strlen(kEntry));
    more[name] = left_out(file, words, left);
    if (more[name].data.empty())
      bad_data("packed tensors: ", name, " is \"", words.substr(0, 80),
               "\", want \"as NAME\" of a tensor in the file, or ", "\"zeros\", a type and a shape; together at most ",
               kMostZeros, " bytes");
    at = file.metadata.erase(at);
  }
  file.tensors.merge(more);
  for (auto& [name, tensor] : file.tensors) {
    if (tensor.dtype != "F16") continue;
    tensor.data = converted<float, Eigen::half>(tensor.data);
    tensor.dtype = "F32";
  }
  return file;
}

}  // namespace cloam
