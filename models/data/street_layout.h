// Who stands and drives where: a street with its traffic from a seed.
#pragma once
#include <cstdint>

#include "models/data/street_world.h"

namespace cloam {

struct MadeStreet {
  StreetWorld world;
  Track ego;
};

/// All that a car which drives for so many seconds meets. At most 255 actors.
MadeStreet make_street(uint64_t seed, bool night, double seconds);

}  // namespace cloam
