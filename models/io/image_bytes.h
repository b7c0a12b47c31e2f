// What the bytes of an image's file say before a decoder sees them: which format they are, and whether all are there.
#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace cloam {

constexpr int kLongestImageSide = 1 << 17;

/// Fault::data: the image is damaged, and why.
[[noreturn]] void damaged_image(const std::filesystem::path& path, const std::string& why);

bool starts_with(const std::vector<std::uint8_t>& bytes, std::string_view magic, std::size_t at = 0);

/// "png", "jpeg" and "openexr" are the formats that are read; all others are named for the error alone.
std::string format_of(const std::vector<std::uint8_t>& bytes);
/// By the extension: one of those that are read, else the extension itself.
std::string format_of_name(const std::filesystem::path& path);

/// Fault::data for a format that is not read, and for a name that says another one.
void require_format(const std::filesystem::path& path, const std::string& format,
                    const std::vector<std::uint8_t>& bytes);

/// Walks the file to its end mark. Fault::data for one that was cut short or has wrong checksums, and for an EXR that
/// promises more parts than it holds.
void require_sound_bytes(const std::filesystem::path& path, const std::string& format,
                         const std::vector<std::uint8_t>& bytes);

}  // namespace cloam
