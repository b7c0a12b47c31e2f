// What stands beside a made street and what lies on it.
#pragma once
#include "models/synth/procedural.h"
#include "models/synth/street_world.h"

namespace cloam {

/// Lanes from the middle outwards, the same on both sides: driving lanes, a strip for bicycles, parking, kerb.
struct StreetPlan {
  int lanes = 1;         // each way
  double crossing = 40;  // where the zebra crossing begins, along the street
  double grass = 0.5;    // share of the ground behind the pavement

  double lane_edge() const { return 3.5 * lanes; }
  double lane_middle(int lane) const { return 3.5 * lane + 1.75; }
  double bicycles() const { return lane_edge() + 0.55; }
  double parking_edge() const { return lane_edge() + 1.1; }
  double parking() const { return lane_edge() + 2.3; }
  double kerb() const { return lane_edge() + 3.5; }
  double pavement() const { return kerb() + 3.8; }  // its outer edge
};

/// Asphalt with markings, kerbs, slabs; asked in street coordinates.
Material ground_material(const StreetPlan& plan);

struct BuildingShape {
  double width = 12, depth = 10, height = 12;  // the front is `width` wide and looks along -y
};
std::shared_ptr<const Thing> make_building(const BuildingShape& shape, HostRandom& random);
std::shared_ptr<const Thing> make_tree(HostRandom& random);
/// Its arm reaches along +y; the light hangs at lamp_head.
std::shared_ptr<const Thing> make_street_lamp();
constexpr double kLampHeight = 6.2, kLampReachOut = 1.6;
/// A hedge, a bin or a box for letters.
std::shared_ptr<const Thing> make_furniture(HostRandom& random);

}  // namespace cloam
