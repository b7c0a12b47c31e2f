// Table-driven, eight bytes a step ("slicing by 8", Kounavis and Berry, ISCC 2005).
#include "models/io/crc32c.h"

#include <fmt/format.h>

#include <array>
#include <cstring>

namespace cloam {
namespace {

constexpr uint32_t kPolynomial = 0x82f63b78;  // x^32 + x^28 + … + 1 with the lowest power in the highest bit

using Tables = std::array<std::array<uint32_t, 256>, 8>;

// tables[k][b] is the checksum of byte b followed by k zero bytes.
constexpr Tables make_tables() {
  Tables tables{};
  for (uint32_t byte = 0; byte < 256; ++byte) {
    uint32_t sum = byte;
    for (int bit = 0; bit < 8; ++bit) sum = (sum >> 1) ^ ((sum & 1) ? kPolynomial : 0);
    tables[0][byte] = sum;
  }
  for (size_t k = 1; k < 8; ++k) {
    for (size_t byte = 0; byte < 256; ++byte) {
      const uint32_t before = tables[k - 1][byte];
      tables[k][byte] = (before >> 8) ^ tables[0][before & 255];
    }
  }
  return tables;
}

constexpr Tables kTables = make_tables();

uint32_t after_eight_bytes(uint32_t sum, const std::byte* bytes) {
  uint64_t word = 0;
  std::memcpy(&word, bytes, 8);  // little-endian, as all our formats
  word ^= sum;
  uint32_t next = 0;
  for (size_t k = 0; k < 8; ++k) next ^= kTables[7 - k][(word >> (8 * k)) & 255];
  return next;
}

}  // namespace

uint32_t crc32c(std::span<const std::byte> bytes, uint32_t previous) {
  uint32_t sum = ~previous;
  size_t i = 0;
  for (; i + 8 <= bytes.size(); i += 8) sum = after_eight_bytes(sum, bytes.data() + i);
  for (; i < bytes.size(); ++i) sum = (sum >> 8) ^ kTables[0][(sum ^ static_cast<uint32_t>(bytes[i])) & 255];
  return ~sum;
}

std::string crc32c_digits(uint32_t checksum) { return fmt::format("{:08x}", checksum); }

}  // namespace cloam
