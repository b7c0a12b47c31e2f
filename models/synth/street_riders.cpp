// See street_riders.h. Everybody looks along +y; z is measured from the ground.
#include "models/synth/street_riders.h"

#include <array>
#include <cmath>

#include "models/synth/thing_builder.h"

namespace cloam {
namespace {

using Eigen::Vector3d;

const Vector3d kDark(0.03, 0.03, 0.035), kSteel(0.4, 0.4, 0.42);

Vector3d cloth(HostRandom& random) {
  static const std::array<Vector3d, 9> cloths{{{0.45, 0.04, 0.04},
                                               {0.05, 0.10, 0.35},
                                               {0.60, 0.58, 0.55},
                                               {0.05, 0.05, 0.06},
                                               {0.08, 0.28, 0.12},
                                               {0.65, 0.40, 0.05},
                                               {0.30, 0.10, 0.30},
                                               {0.15, 0.35, 0.45},
                                               {0.30, 0.22, 0.14}}};
  return random.between(0.8, 1.2) * cloths[std::size_t(random.one_of(cloths.size()))];
}

Vector3d skin(HostRandom& random) { return random.between(0.25, 1) * Vector3d(0.62, 0.38, 0.26); }

/// Face in front, hair or helmet elsewhere.
void add_head(ThingBuilder& build, const Vector3d& centre, const Vector3d& face, const Vector3d& cover) {
  build.sphere(centre, 0.125, [=](const Spot& spot) {
    const bool front = spot.normal.y() > 0.35 && spot.normal.z() < 0.6;
    return Surface{front ? face : cover, Vector3d::Zero(), 0};
  });
}

struct Outfit {
  Vector3d jacket, trousers, skin, hair;
  explicit Outfit(HostRandom& random)
      : jacket(cloth(random)),
        trousers(cloth(random)),
        skin(cloam::skin(random)),
        hair(random.between(0.02, 0.2) * Vector3d(1, 0.75, 0.5)) {}
};

RoadUserAppearance make_pedestrian(HostRandom& random) {
  ThingBuilder build;
  const Outfit outfit(random);
  const double height = random.between(1.55, 1.92), hip = 0.47 * height, neck = 0.84 * height;
  const double stride = random.between(0.1, 0.24), girth = random.between(0.9, 1.15);
  const Material leg = plain(outfit.trousers), arm = plain(0.85 * outfit.jacket);
  build.tapered({0.03, 0.17}, {stride - 0.09, stride + 0.12}, {0, hip}, {0, {-0.08, 0.09}}, leg);
  build.tapered({-0.17, -0.03}, {-stride - 0.09, -stride + 0.12}, {0, hip}, {0, {-0.08, 0.09}}, leg);
  build.tapered({-0.19 * girth, 0.19 * girth}, {-0.11, 0.12}, {hip - 0.03, neck}, {0.03, {-0.09, 0.09}},
                plain(outfit.jacket));
  build.tapered({0.19 * girth, 0.27 * girth}, {-stride - 0.04, -stride + 0.06}, {hip, neck - 0.04}, {0, {-0.06, 0.05}},
                arm);
  build.tapered({-0.27 * girth, -0.19 * girth}, {stride - 0.06, stride + 0.04}, {hip, neck - 0.04}, {0, {-0.05, 0.06}},
                arm);
  add_head(build, {0, 0.02, height - 0.125}, outfit.skin, outfit.hair);
  const bool loaded = random.chance(0.35);
  if (loaded) build.block({-0.15, 0.15}, {-0.29, -0.10}, {hip + 0.1, neck - 0.05}, plain(cloth(random)));
  return {loaded ? "Pedestrian with Object" : "Pedestrian", build.finish()};
}

struct Seat {
  double y = -0.2, z = 0.8;  // of the hips
  double lean = 0.3;         // of the shoulders before them
  double hands = 0.5;        // forward
  double foot_y = 0.1, foot_z = 0.3;
};

void add_rider(ThingBuilder& build, const Seat& seat, const Outfit& outfit, const Vector3d& helmet) {
  const double neck = seat.z + 0.58, shoulder = seat.y + seat.lean;
  build.tapered({-0.18, 0.18}, {seat.y - 0.12, seat.y + 0.12}, {seat.z, neck},
                {0.0, {shoulder - 0.10, shoulder + 0.10}}, plain(outfit.jacket));
  build.pair({0.18, 0.26}, {shoulder - 0.05, seat.hands}, {neck - 0.26, neck - 0.14}, plain(0.85 * outfit.jacket));
  build.pair({0.08, 0.2}, {seat.y - 0.1, seat.y + 0.42}, {seat.z - 0.1, seat.z + 0.06}, plain(outfit.trousers));
  build.pair({0.08, 0.2}, {seat.foot_y - 0.06, seat.foot_y + 0.1}, {seat.foot_z, seat.z}, plain(outfit.trousers));
  add_head(build, {0, shoulder + 0.05, neck + 0.13}, outfit.skin, helmet);
}

RoadUserAppearance make_bicycle(HostRandom& random) {
  ThingBuilder build;
  const Vector3d frame = cloth(random);
  const double radius = 0.34, base = random.between(0.49, 0.54);
  const Eigen::Matrix3d across = turn_about_z(0.5 * M_PI);  // rings lie in the xz plane
  for (const double y : {base, -base}) {
    build.add(make_placed(make_ring({radius - 0.03, 0.03, 0, -1}), {0, y, radius}, across), plain(kDark));
  }
  build.block({-0.03, 0.03}, {-base, -base + 0.9}, {0.5, 0.57}, plain(frame));
  build.tapered({-0.03, 0.03}, {base - 0.03, base + 0.03}, {radius, 1.0}, {0, {base - 0.16, base - 0.1}}, plain(frame));
  build.tapered({-0.03, 0.03}, {-0.12, -0.06}, {0.3, 0.92}, {0, {-0.3, -0.24}}, plain(frame));
  build.block({-0.28, 0.28}, {base - 0.18, base - 0.12}, {0.98, 1.03}, plain(kDark));
  build.block({-0.04, 0.04}, {base - 0.1, base - 0.02}, {0.88, 0.96}, lamp({0.85, 0.84, 0.78}, 1));
  build.block({-0.04, 0.04}, {-0.4, -0.34}, {0.75, 0.83}, lamp({0.6, 0.02, 0.02}, 1));
  add_rider(build, {-0.25, 0.93, 0.28, base - 0.12, 0.02, 0.25}, Outfit(random), cloth(random));
  return {"Bicycle", build.finish()};
}

RoadUserAppearance make_motorcycle(HostRandom& random, bool scooter) {
  ThingBuilder build;
  const Vector3d colour = cloth(random);
  const double base = scooter ? 0.62 : random.between(0.70, 0.78), radius = scooter ? 0.24 : 0.32;
  for (const double y : {base, -base}) build.wheel({-0.07, 0.07}, y, radius, kSteel);
  build.tapered({-0.04, 0.04}, {base - 0.06, base + 0.06}, {radius, 1.05}, {0, {base - 0.3, base - 0.2}},
                plain(kSteel));
  build.block({-0.36, 0.36}, {base - 0.34, base - 0.27}, {1.02, 1.08}, plain(kDark));
  build.block({-0.1, 0.1}, {base - 0.22, base - 0.08}, {0.82, 1.0}, lamp({0.85, 0.84, 0.78}, 1.1));
  build.block({-0.08, 0.08}, {-base - 0.22, -base - 0.12}, {0.72, 0.82}, lamp({0.6, 0.02, 0.02}, 1.2));
  if (scooter) {
    build.tapered({-0.2, 0.2}, {0.28, 0.36}, {0.28, 0.95}, {0.04, {0.18, 0.26}}, plain(colour, 0.05));
    build.block({-0.18, 0.18}, {-0.3, 0.36}, {0.22, 0.3}, plain(colour));
    build.block({-0.17, 0.17}, {-base - 0.15, -0.15}, {0.3, 0.74}, plain(colour, 0.05));
  } else {
    build.block({-0.16, 0.16}, {-0.35, 0.4}, {0.28, 0.62}, plain({0.12, 0.12, 0.13}));
    build.tapered({-0.15, 0.15}, {-0.2, 0.45}, {0.6, 0.92}, {0.04, {-0.1, 0.3}}, plain(colour, 0.06));
    build.block({-0.12, 0.12}, {-base - 0.2, -0.15}, {0.64, 0.76}, plain(kDark));
    build.block({0.12, 0.2}, {-base - 0.1, -0.1}, {0.3, 0.4}, plain(kSteel));  // exhaust
  }
  add_rider(build, {-0.3, 0.76, 0.22, base - 0.3, 0.05, 0.3}, Outfit(random), cloth(random));
  return {scooter ? "Motorized Scooter" : "Motorcycle", build.finish()};
}

}  // namespace

RoadUserAppearance make_rider(RoadUser kind, HostRandom& random) {
  if (kind == RoadUser::pedestrian) return make_pedestrian(random);
  if (kind == RoadUser::bicycle) return make_bicycle(random);
  return make_motorcycle(random, kind == RoadUser::scooter);
}

}  // namespace cloam
