// The JSON header of a safetensors file as data. Used by safetensors.cpp alone.
#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace cloam {

/// begin and end: bytes from the start of the data section.
struct SafetensorsEntry {
  std::string dtype;
  std::vector<int64_t> shape;
  uint64_t begin = 0, end = 0;
};

struct SafetensorsHeader {
  std::map<std::string, SafetensorsEntry> entries;
  std::map<std::string, std::string> metadata;
};

/// Accepts the exact form and nothing else: no unknown, missing or repeated key, no fraction or sign in a size.
/// Memory is bounded as parse_json bounds it. Errors: Fault::data that says what was found where.
SafetensorsHeader parse_safetensors_header(std::string_view header);

/// Bytes of one value, 0 for an unknown dtype.
uint64_t dtype_bytes(std::string_view dtype);

std::string shape_text(const std::vector<int64_t>& shape);
std::string json_string(const std::string& value);
std::string json_text(const SafetensorsEntry& entry);

/// A name from an untrusted file for use in a message: cut to 80 bytes, control bytes as '?'.
std::string printable(std::string_view name);

}  // namespace cloam
