// Names and labels that come from users and files.
#pragma once
#include <algorithm>
#include <cctype>
#include <cstdint>
#include <string>
#include <vector>

namespace cloam {

/// ASCII letters alone; others stay as they are.
inline std::string lower_case(std::string word) {
  std::transform(word.begin(), word.end(), word.begin(), [](unsigned char c) { return std::tolower(c); });
  return word;
}

/// The name among `names` that is most like `wanted`, or "" if none is near: for "did you mean".
std::string nearest_name(const std::string& wanted, const std::vector<std::string>& names);
/// "; did you mean NAME?", or "".
std::string did_you_mean(const std::string& wanted, const std::vector<std::string>& names);

/// "a, b, c".
std::string joined(const std::vector<std::string>& words, const std::string& between = ", ");
/// A word as a shell takes it.
std::string quoted(const std::string& word);
/// "600 MB", "1.5 GB".
std::string words_for_bytes(uint64_t bytes);
/// "12s", "3m05s", "1h02m".
std::string words_for_seconds(double seconds);

}  // namespace cloam
