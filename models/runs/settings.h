// Settings from a --config file.
#pragma once
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace cloam {

/// The keys of a TOML file with their values as --set would take them; tables become dotted keys.
/// Fault::usage for a file that cannot be read, is no TOML (with line and column), or holds lists or dates.
std::vector<std::pair<std::string, std::string>> read_settings(const std::filesystem::path& path);

/// "key=value" -> both. Fault::usage without "=".
std::pair<std::string, std::string> split_setting(const std::string& setting);

}  // namespace cloam
