// Labels by class.
#include "models/scene/asset_class.h"

#include <algorithm>
#include <cctype>
#include <utility>

#include "models/io/words.h"

namespace cloam {
namespace {

// The first entry whose words a label begins with decides.
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
    {"vehicle.car", 0},  // nuScenes
    {"vehicle.truck", 1},
    {"vehicle.bus", 2},
    {"vehicle.construction", 3},
    {"vehicle.emergency", 4},
    {"vehicle.bicycle", 5},
    {"vehicle.motorcycle", 6},
    {"human.pedestrian", 7},
    {"vehicle.trailer", kAssetClassCount - 1},
    {"vehicle", 0},  // Waymo: of any kind, most are cars
};

/// Does a label begin with these words? Whole ones: "Personal Mobility Device" is no person.
bool begins(const std::string& label, const std::string& words) {
  return label.starts_with(words) &&
         (label.size() == words.size() || !std::isalnum(static_cast<unsigned char>(label[words.size()])));
}

}  // namespace

int asset_class(const std::string& label) {
  const std::string word = lower_case(label);
  for (const auto& [beginning, index] : kBeginnings)
    if (begins(word, beginning)) return index;
  return kAssetClassCount - 1;
}

}  // namespace cloam
