// Gzip in memory, with limits that stop a small file from becoming a large one.
#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace cloam {

/// The content of one whole gzip stream; `name` stands at the head of errors. Fault::data for a stream that is damaged,
/// cut short or followed by other bytes, that holds more than `largest` bytes or more than most_unpacked.
std::vector<std::uint8_t> gunzip(std::span<const std::uint8_t> bytes, std::uint64_t largest, const std::string& name);

/// What packed data of so many bytes may hold at most: 16 MB, or 200 times as much.
std::uint64_t most_unpacked(std::uint64_t packed);

/// Unpacks a deflate stream without any header. False unless the whole of it gives exactly these bytes.
bool inflate_exactly(std::span<const std::uint8_t> bytes, std::span<std::uint8_t> result);

/// Equal contents give equal bytes: no name and no time are stored.
std::vector<std::uint8_t> gzip(std::span<const std::uint8_t> bytes);

bool is_gzip(std::span<const std::uint8_t> bytes);

}  // namespace cloam
