// Who stands and drives where: a street with its traffic from a seed.
#pragma once
#include <cstdint>

#include "models/synth/street_world.h"

namespace cloam {

struct MadeStreet {
  StreetWorld world;
  Track ego;
  double sway = 0;  // degrees to either side that the car's heading turns from its way and back, once a second
};

struct Weather {
  bool night = false;
  double clouds = 0;  // share of the sun's light that they take and the sky gives back; not at night
};

/// All that a car which drives for so many seconds meets. At most 255 actors.
MadeStreet make_street(uint64_t seed, const Weather& weather, double seconds);

}  // namespace cloam
