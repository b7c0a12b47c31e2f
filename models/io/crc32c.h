// CRC-32C (Castagnoli), the checksum of iSCSI and ext4: finds every error of one bit and every burst of up to 32 bits.
#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace cloam {

/// Checksum of `bytes`; pass the result of the bytes before as `previous` to go on with a longer message.
uint32_t crc32c(std::span<const std::byte> bytes, uint32_t previous = 0);

/// Eight lower-case hexadecimal digits.
std::string crc32c_digits(uint32_t checksum);

}  // namespace cloam
