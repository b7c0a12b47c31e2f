// Names and labels that come from users and files.
#pragma once
#include <algorithm>
#include <cctype>
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

}  // namespace cloam
