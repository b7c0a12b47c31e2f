// Labels by class.
#include "models/scene/asset_class.h"

#include <algorithm>
#include <cctype>
#include <utility>

namespace cloam {
namespace {

std::string lower(std::string word) {
  std::transform(word.begin(), word.end(), word.begin(), [](unsigned char c) { return std::tolower(c); });
  return word;
}

// The first word that a label begins with decides, so that special ones stand before general ones.
const std::pair<const char*, int> kBeginnings[] = {
    {"car", 0},
    {"pickup", 1},
    {"medium-sized truck", 1},
    {"semi-truck", 1},
    {"truck", 1},
    {"van", 1},
    {"bus", 2},
    {"tram", 2},
    {"other vehicle - construction", 3},
    {"construction vehicle", 3},
    {"emergency vehicle", 4},
    {"bicycle", 5},
    {"cyclist", 5},
    {"motorcycle", 6},
    {"motorized scooter", 6},
    {"pedestrian", 7},
    {"person", 7},
};

}  // namespace

int asset_class(const std::string& label) {
  const std::string word = lower(label);
  for (const auto& [beginning, index] : kBeginnings)
    if (word.starts_with(beginning)) return index;
  return kAssetClassCount - 1;
}

}  // namespace cloam
