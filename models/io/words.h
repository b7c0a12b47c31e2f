// Letters of names and labels that come from users and files.
#pragma once
#include <algorithm>
#include <cctype>
#include <string>

namespace cloam {

/// ASCII letters alone; others stay as they are.
inline std::string lower_case(std::string word) {
  std::transform(word.begin(), word.end(), word.begin(), [](unsigned char c) { return std::tolower(c); });
  return word;
}

}  // namespace cloam
