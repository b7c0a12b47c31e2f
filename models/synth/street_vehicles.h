// The road users of made streets: a shape prior for each class of the GenAssets paper's Table A1, with sizes, colours
// and details drawn for each instance. Front and rear differ; left and right do in buses and loaders alone.
#pragma once
#include <string>

#include "models/synth/procedural.h"
#include "models/synth/street_world.h"

namespace cloam {

enum class RoadUser {
  car,
  pickup,
  truck,
  semi,
  bus,
  construction,
  emergency,
  motorcycle,
  scooter,
  bicycle,
  pedestrian
};

struct RoadUserAppearance {
  std::string label;  // PandaSet's word
  std::shared_ptr<const Thing> thing;
};

RoadUserAppearance make_road_user(RoadUser kind, HostRandom& random);

}  // namespace cloam
