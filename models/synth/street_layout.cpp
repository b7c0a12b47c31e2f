// See street_layout.h.
#include "models/synth/street_layout.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "models/synth/procedural.h"
#include "models/synth/street_scenery.h"
#include "models/synth/street_vehicles.h"
#include "models/synth/thing_builder.h"

namespace cloam {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kBehind = 22, kAhead = 52;  // metres around the ego car in which there is traffic
constexpr double kClear = 8;                 // free road before and behind the ego car
constexpr std::size_t kMaxActors = 255;

struct Share {
  RoadUser kind;
  double weight;
};
constexpr std::array<Share, 9> kMoving{{{RoadUser::car, 0.46},
                                        {RoadUser::pickup, 0.10},
                                        {RoadUser::truck, 0.10},
                                        {RoadUser::semi, 0.04},
                                        {RoadUser::bus, 0.09},
                                        {RoadUser::construction, 0.05},
                                        {RoadUser::emergency, 0.08},
                                        {RoadUser::motorcycle, 0.05},
                                        {RoadUser::scooter, 0.03}}};
constexpr std::array<Share, 5> kParked{{{RoadUser::car, 0.70},
                                        {RoadUser::pickup, 0.13},
                                        {RoadUser::truck, 0.07},
                                        {RoadUser::construction, 0.04},
                                        {RoadUser::emergency, 0.06}}};

template <class Shares>
RoadUser draw(const Shares& shares, HostRandom& random) {
  double sum = random.between(0, 1);
  for (const Share& share : shares) {
    if ((sum -= share.weight) < 0) return share.kind;
  }
  return shares[0].kind;
}

std::string draw_id(HostRandom& random) {
  const uint64_t a = random.next(), b = random.next();
  return fmt::format("{:08x}-{:04x}-{:04x}-{:04x}-{:012x}", a >> 32, a >> 16 & 0xffff, a & 0xffff, b >> 48,
                     b & 0xffffffffffff);
}

class Layout {
 public:
  Layout(uint64_t seed, const Weather& weather, double seconds)
      : weather_(weather),
        random_(seed),
        actor_random_(seed ^ 0x6163746f72),
        scenery_random_(seed ^ 0x7363656e65),
        seconds_(seconds) {
    made_.world.light.night = weather.night;
  }

  MadeStreet make() {
    lay_out();
    add_traffic();
    add_parked();
    add_people();
    add_houses();
    add_pavement();
    add_light();
    made_.world.scenery = std::make_shared<ThingSet>(std::move(scenery_));
    made_.world.ground = ground_material(plan_);
    return std::move(made_);
  }

 private:
  void lay_out() {
    plan_.lanes = 1 + random_.one_of(2);
    plan_.crossing = random_.between(15, 60);
    plan_.grass = random_.between(0.2, 0.8);
    Course& course = made_.world.course;
    course.kerb = plan_.kerb();
    course.curvature = random_.chance(0.35) ? 0 : random_.between(-1, 1) / 180;
    made_.ego.right = plan_.lane_middle(random_.one_of(plan_.lanes));
    made_.ego.speed = random_.between(5.5, 9);
  }

  // Along the street, where the car can meet something of this speed.
  Extent window(double speed) const {
    const double gains = (speed - made_.ego.speed) * seconds_;
    return {-kBehind - std::max(0.0, gains), kAhead + std::max(0.0, -gains)};
  }

  void add_actor(RoadUserAppearance appearance, const Track& track, bool parked) {
    if (made_.world.actors.size() >= kMaxActors) return;
    made_.world.actors.push_back(
        {draw_id(actor_random_), appearance.label, std::move(appearance.thing), track, parked});
  }

  /// Vehicles one behind the other at one speed, with gaps.
  template <class Shares>
  void fill_lane(const Shares& kinds, const Track& lane, Extent gap, bool parked) {
    const Extent range = window(lane.speed);
    double along = range.low + actor_random_.between(0, gap.high);
    while (along < range.high) {
      RoadUserAppearance appearance = make_road_user(draw(kinds, actor_random_), actor_random_);
      const double half = 0.5 * appearance.thing->bounds.sizes().y();
      Track track = lane;
      track.along = along + half;
      along += 2 * half + actor_random_.between(gap.low, gap.high);
      if (parked) {
        track.right += actor_random_.between(-0.12, 0.12);
        track.turn += actor_random_.between(-0.03, 0.03);
      }
      const bool in_the_way = std::abs(lane.right - made_.ego.right) < 2 && std::abs(track.along) < half + kClear;
      if (!in_the_way) add_actor(std::move(appearance), track, parked);
    }
  }

  void add_traffic() {
    for (int lane = 0; lane < plan_.lanes; ++lane) {
      const double right = plan_.lane_middle(lane);
      const bool own = std::abs(right - made_.ego.right) < 0.1;
      const double with = own ? made_.ego.speed : made_.ego.speed + random_.between(-3, 2);
      fill_lane(kMoving, {0, right, with, 0}, {7, 26}, false);
      fill_lane(kMoving, {0, -right, -random_.between(5, 10), M_PI}, {8, 28}, false);
    }
  }

  void add_parked() {
    for (const double side : {1.0, -1.0}) {
      fill_lane(kParked, {0, side * plan_.parking(), 0, side > 0 ? 0 : M_PI}, {1.5, 14}, true);
    }
  }

  void add_people() {
    for (const double side : {1.0, -1.0}) {
      const double turn = side > 0 ? 0 : M_PI;
      const double pace = side * random_.between(3, 5);
      for (int i = 0, count = 1 + actor_random_.one_of(2); i < count; ++i) {
        const double along = actor_random_.between(-8, 55) + (side < 0 ? 12 : 0);
        add_actor(make_road_user(RoadUser::bicycle, actor_random_),
                  {along + 9 * i, side * plan_.bicycles(), pace, turn}, false);
      }
      for (int i = 0, count = 2 + actor_random_.one_of(3); i < count; ++i) add_walker(side);
    }
  }

  void add_walker(double side) {
    HostRandom& random = actor_random_;
    Track track;
    track.along = random.between(-10, 45);
    track.right = side * random.between(plan_.kerb() + 0.95, plan_.kerb() + 1.65);
    const bool stands = random.chance(0.25);
    if (stands) {
      track.turn = random.between(-M_PI, M_PI);
    } else {
      const double way = random.chance(0.5) ? 1 : -1;
      track.speed = way * random.between(1.0, 1.6);
      track.turn = way > 0 ? 0 : M_PI;
    }
    add_actor(make_road_user(RoadUser::pedestrian, random), track, stands);
  }

  void place(std::shared_ptr<const Thing> thing, double along, double right, double turn) {
    const Course& course = made_.world.course;
    const Vector2d at = course.place(along, right);
    const double yaw = course.yaw(along) + turn;
    scenery_.push_back({std::move(thing), {at.x(), at.y(), course.ground(right)}, {std::cos(yaw), std::sin(yaw)}});
  }

  Extent surroundings() const { return {-90, made_.ego.speed * seconds_ + 230}; }

  void add_houses() {
    HostRandom& random = scenery_random_;
    for (const double side : {1.0, -1.0}) {
      double along = surroundings().low + random.between(0, 10);
      while (along < surroundings().high) {
        BuildingShape shape{random.between(9, 22), random.between(9, 14), random.between(5, 16)};
        const double back = plan_.pavement() + random.between(0.4, 4.5) + 0.5 * shape.depth;
        // Fronts look along -y of the thing, which is towards the street.
        place(make_building(shape, random), along + 0.5 * shape.width, side * back, -side * 0.5 * M_PI);
        along += shape.width + (random.chance(0.25) ? random.between(7, 14) : random.between(0.8, 3));
      }
    }
  }

  void add_pavement() {
    HostRandom& random = scenery_random_;
    const auto lamp = make_street_lamp();
    for (const double side : {1.0, -1.0}) {
      const Extent range = surroundings();
      for (double along = range.low; along < range.high; along += random.between(8, 20)) {
        place(make_tree(random), along, side * (plan_.kerb() + 2.2), random.between(-M_PI, M_PI));
        if (random.chance(0.4)) {
          place(make_furniture(random), along + 4, side * (plan_.pavement() + random.between(-0.6, 0.1)), 0.5 * M_PI);
        }
      }
      // The thing turns about the middle of its arm.
      const double arm = lamp->pivot().y();
      for (double along = range.low + (side > 0 ? 0 : 13); along < range.high; along += 26) {
        place(lamp, along, side * (plan_.kerb() + 0.5 - arm), side * 0.5 * M_PI);
        scenery_.back().position.z() = made_.world.course.step;
        const Vector2d head = made_.world.course.place(along, side * (plan_.kerb() + 0.5 - kLampReachOut));
        if (made_.world.light.night) {
          made_.world.light.lamps.push_back({head.x(), head.y(), made_.world.course.step + kLampHeight - 0.3});
        }
      }
    }
  }

  void add_light() {
    Light& light = made_.world.light;
    const double azimuth = random_.between(0, 2 * M_PI), height = random_.between(0.7, 1.15);
    const double bright = random_.between(0.85, 1.1), warm = random_.between(0, 1);
    light.to_sun = {std::cos(height) * std::cos(azimuth), std::cos(height) * std::sin(azimuth), std::sin(height)};
    light.sun = bright * mix({1.0, 0.97, 0.92}, {1.06, 0.90, 0.70}, warm);
    light.sky = bright * Vector3d(0.42, 0.46, 0.54);
    light.bounce = bright * Vector3d(0.25, 0.24, 0.21);
    light.zenith = mix({0.16, 0.32, 0.62}, {0.26, 0.36, 0.52}, random_.between(0, 1));
    light.horizon = mix({0.66, 0.74, 0.82}, {0.78, 0.76, 0.70}, warm);
    light.glare = {0.30, 0.26, 0.18};
    if (!light.night) return cover(light);
    light.sun.setZero();
    light.glare.setZero();
    light.sky = {0.055, 0.062, 0.085};
    light.bounce = {0.035, 0.034, 0.038};
    light.zenith = {0.004, 0.006, 0.014};
    light.horizon = {0.020, 0.023, 0.034};
  }

  /// Clouds scatter the sun's light: as much reaches a roof, from everywhere above.
  void cover(Light& light) const {
    const double clouds = weather_.clouds;
    const Vector3d scattered = clouds * light.to_sun.z() * light.sun;
    light.sun *= 1 - clouds;
    light.glare *= 1 - clouds;
    light.sky += 0.5 * scattered;
    light.bounce += 0.25 * scattered;
    light.zenith = mix(light.zenith, {0.62, 0.64, 0.68}, clouds);
    light.horizon = mix(light.horizon, {0.74, 0.75, 0.77}, clouds);
  }

  Weather weather_;
  MadeStreet made_;
  StreetPlan plan_;
  std::vector<PlacedThing> scenery_;
  HostRandom random_, actor_random_, scenery_random_;
  double seconds_;
};

}  // namespace

MadeStreet make_street(uint64_t seed, const Weather& weather, double seconds) {
  return Layout(seed, weather, seconds).make();
}

}  // namespace cloam
