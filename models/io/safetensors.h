// Strict reader and writer of safetensors files (github.com/huggingface/safetensors): 8 bytes header length, JSON
// header, raw little-endian data. Our files add a CRC32C per tensor and one for the header, kept as metadata strings
// that other readers ignore, so that each changed bit is found.
#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace cloam {

/// Row-major values. dtype: BOOL U8 I8 U16 I16 F16 BF16 U32 I32 F32 U64 I64 F64.
struct NamedTensor {
  std::string dtype;
  std::vector<int64_t> shape;
  std::vector<std::byte> data;

  bool operator==(const NamedTensor&) const = default;
};

using TensorMap = std::map<std::string, NamedTensor>;

/// metadata: free strings; names that begin with "crc32c" are ours and never appear here.
struct SafetensorsFile {
  TensorMap tensors;
  std::map<std::string, std::string> metadata;

  bool operator==(const SafetensorsFile&) const = default;
};

/// Writes through commit_file. Equal contents give equal bytes.
/// Errors: Fault::diverged naming the tensor for an F32 or F16 value that is NaN or infinite (nothing is written);
/// Fault::internal when data and shape disagree; Fault::write when the disk refuses.
void write_safetensors(const std::filesystem::path& path, const SafetensorsFile& file);

/// Reads and checks a regular file; every size is checked against the file before memory is asked for.
/// Errors: Fault::data naming the tensor and the byte offset.
SafetensorsFile read_safetensors(const std::filesystem::path& path);

/// Whether the file at `path` holds what `file` does; of its tensors one lies in memory at a time. Errors as above.
bool reads_back(const std::filesystem::path& path, const SafetensorsFile& file);

}  // namespace cloam
