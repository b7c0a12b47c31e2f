// SHA-256 (FIPS 180-4), by which published files are known.
#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

namespace cloam {

/// Of bytes that come in parts.
class Sha256 {
 public:
  void add(std::span<const std::uint8_t> bytes);
  /// 64 lower-case hexadecimal digits. Ends the message: nothing can be added after it.
  std::string digits();

 private:
  void take_block(const std::uint8_t* block);
  std::array<std::uint32_t, 8> state_ = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                         0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
  std::array<std::uint8_t, 64> waiting_ = {};
  std::uint64_t length_ = 0;  // bytes so far; its last six bits say how many wait
};

/// Of a file, a part at a time. Fault::data if it cannot be read.
std::string sha256_of_file(const std::filesystem::path& path);

}  // namespace cloam
