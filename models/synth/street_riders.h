// People of made streets: on foot, on two wheels. Called through street_vehicles.h.
#pragma once
#include "models/synth/street_vehicles.h"

namespace cloam {

/// kind: motorcycle, scooter, bicycle or pedestrian.
RoadUserAppearance make_rider(RoadUser kind, HostRandom& random);

}  // namespace cloam
