// See street_vehicles.h. Every vehicle looks along +y; z is measured from the road.
#include "models/synth/street_vehicles.h"

#include <array>
#include <cmath>

#include "models/synth/street_riders.h"
#include "models/synth/thing_builder.h"

namespace cloam {
namespace {

using Eigen::Vector3d;

const Vector3d kPlastic(0.035, 0.035, 0.038), kChrome(0.45, 0.46, 0.48), kWhite(0.78, 0.78, 0.76);
const Vector3d kHeadlight(0.85, 0.84, 0.78), kTaillight(0.55, 0.02, 0.015), kOrange(0.75, 0.26, 0.02);
const Material kGlass = glass();

Vector3d car_paint(HostRandom& random) {
  static const std::array<Vector3d, 14> paints{{{0.75, 0.75, 0.74},  // white
                                                {0.70, 0.70, 0.68},
                                                {0.45, 0.46, 0.47},  // silver
                                                {0.16, 0.17, 0.18},  // grey
                                                {0.028, 0.028, 0.03},
                                                {0.42, 0.025, 0.02},  // red
                                                {0.55, 0.07, 0.03},
                                                {0.025, 0.07, 0.32},  // blue
                                                {0.09, 0.22, 0.45},
                                                {0.03, 0.15, 0.07},  // green
                                                {0.38, 0.31, 0.20},  // sand
                                                {0.72, 0.46, 0.03},  // yellow
                                                {0.65, 0.20, 0.02},  // orange
                                                {0.16, 0.03, 0.09}}};
  const double shade = random.between(0.85, 1.15);
  return (shade * paints[std::size_t(random.one_of(paints.size()))]).cwiseMin(0.85);
}

struct Size {
  double width = 1.8, length = 4.5, height = 1.5;
  double half() const { return 0.5 * width; }
  double front() const { return 0.5 * length; }
};

/// The lower part of a car: paint with a dark sill and the gaps of its doors at `doors`.
Material coachwork(const Vector3d& colour, std::array<double, 3> doors) {
  return [=](const Spot& spot) -> Surface {
    const Vector3d& p = spot.point;
    double dark = inside(p.z(), 0, 0.27, spot.width(Vector3d::UnitZ()));
    if (std::abs(spot.normal.x()) > 0.7) {
      for (const double door : doors) {
        dark = std::max(dark, 0.8 * inside(p.y(), door - 0.02, door + 0.02, spot.width(Vector3d::UnitY())));
      }
    }
    return {mix(colour, 0.12 * colour, dark), Vector3d::Zero(), 0.05};
  };
}

struct CabinShape {
  Extent x, y, z;
  double rake_front = 0.7, rake_back = 0.3;
  double pillar = 0;  // where the middle one stands
};

/// Windows all around between posts of the roof's colour.
void add_cabin(ThingBuilder& build, const CabinShape& cabin, const Vector3d& colour) {
  const ThingBuilder::Roof roof{0.15, {cabin.y.low + cabin.rake_back, cabin.y.high - cabin.rake_front}};
  build.tapered(cabin.x, cabin.y, cabin.z, roof, [=](const Spot& spot) -> Surface {
    const Vector3d& p = spot.point;
    const double up = (p.z() - cabin.z.low) / (cabin.z.high - cabin.z.low);
    const double band = inside(p.z(), cabin.z.low + 0.05, cabin.z.high - 0.07, spot.width(Vector3d::UnitZ()));
    double pane = 0;
    if (std::abs(spot.normal.x()) > 0.6) {
      const double from = cabin.y.low + up * cabin.rake_back + 0.12, to = cabin.y.high - up * cabin.rake_front - 0.10;
      const double width = spot.width(Vector3d::UnitY());
      pane = inside(p.y(), from, to, width) - inside(p.y(), cabin.pillar - 0.05, cabin.pillar + 0.05, width);
    } else if (spot.normal.z() < 0.97) {
      const double half = cabin.x.high - up * roof.inset - 0.08;
      pane = inside(p.x(), -half, half, spot.width(Vector3d::UnitX()));
    }
    pane = band * std::max(0.0, pane);
    return {mix(colour, {0.025, 0.032, 0.04}, pane), Vector3d::Zero(), 0.03 + 0.13 * pane};
  });
}

/// Head- and tail-lights, grille, bumpers and number plates of a body of this size whose faces are `recess` behind it.
struct Face {
  double light_height = 0.66, light_width = 0.36, light_rise = 0.14;
  double tail_height = 0.78, tail_width = 0.22, tail_rise = 0.24;
  double recess = 0.05;
};

void add_faces(ThingBuilder& build, const Size& size, const Face& face) {
  const double half = size.half() - 0.04, lights = size.half() - 0.1;  // the body is narrower where it is higher
  const double front = size.front(), recess = face.recess;
  const Extent nose{front - recess - 0.06, front - 0.02}, rear{-front + 0.02, -front + recess + 0.06};
  build.pair({lights - face.light_width, lights}, nose, {face.light_height, face.light_height + face.light_rise},
             lamp(kHeadlight, 1.1));
  build.pair({lights - face.tail_width, lights}, rear, {face.tail_height, face.tail_height + face.tail_rise},
             lamp(kTaillight, 1.2));
  build.block({-0.55 * half, 0.55 * half}, {nose.low, nose.high - 0.01},
              {face.light_height - 0.22, face.light_height + 0.10}, plain({0.05, 0.05, 0.055}));
  build.block({-half, half}, {front - 0.2, front}, {0.26, 0.44}, plain(kPlastic));
  build.block({-half, half}, {-front, -front + 0.2}, {0.28, 0.46}, plain(kPlastic));
  build.block({-0.26, 0.26}, {-front + 0.01, -front + recess + 0.06}, {0.56, 0.68}, plain(kWhite));
}

void add_mirrors(ThingBuilder& build, const Size& size, double y, double z) {
  build.pair({size.half() - 0.12, size.half()}, {y, y + 0.12}, {z, z + 0.14}, plain(kPlastic));
}

struct CarPlan {
  Size size;
  double hood = 1.2, trunk = 0.7;  // lengths before and behind the cabin
  double belt = 0.92;              // where the windows begin
  double rake_front = 0.75, rake_back = 0.45;
};

CarPlan draw_car(HostRandom& random) {
  CarPlan plan;
  const int body = random.one_of(3);  // saloon, hatchback, off-roader
  const double stretch = random.between(0, 1);
  if (body == 0) plan = {{1.84, 4.45 + 0.5 * stretch, 1.44}, 1.35, 0.95, 0.90, 0.80, 0.65};
  if (body == 1) plan = {{1.78, 3.75 + 0.6 * stretch, 1.50}, 1.05, 0.10, 0.93, 0.75, 0.35};
  if (body == 2) plan = {{1.92, 4.40 + 0.6 * stretch, 1.74}, 1.25, 0.12, 1.06, 0.55, 0.22};
  plan.size.width += random.between(-0.05, 0.05);
  plan.size.height += random.between(-0.05, 0.06);
  return plan;
}

/// All that saloons, police cars and pickups share: coachwork from bumper to bumper, faces, wheels, mirrors.
void add_car_body(ThingBuilder& build, const CarPlan& plan, const Material& body, const Vector3d& rim) {
  const Size& size = plan.size;
  const double half = size.half() - 0.03, front = size.front() - 0.05, shoulder = 0.62 * plan.belt + 0.1;
  build.tapered({-half + 0.03, half - 0.03}, {-front + 0.08, front - 0.06}, {0.2, shoulder}, {-0.03, {-front, front}},
                body);
  build.tapered({-half, half}, {-front, front}, {shoulder, plan.belt}, {0.07, {-front + 0.06, front - 0.16}}, body);
  add_faces(
      build, size,
      {.light_height = shoulder - 0.04, .tail_height = shoulder + 0.02, .tail_rise = plan.belt - shoulder - 0.05});
  const double radius = 0.30 + 0.06 * (size.height - 1.3), axle = 0.5 * size.length - 0.82;
  for (const double y : {axle, -axle}) build.wheel_pair({half - 0.18, half + 0.02}, y, radius, rim);
  add_mirrors(build, size, size.front() - plan.hood - 0.55, plan.belt - 0.02);
}

void add_car_cabin(ThingBuilder& build, const CarPlan& plan, const Vector3d& roof) {
  const Size& size = plan.size;
  const double half = size.half() - 0.11;
  const Extent y{-size.front() + plan.trunk, size.front() - plan.hood};
  add_cabin(build,
            {{-half, half},
             y,
             {plan.belt - 0.02, size.height},
             plan.rake_front,
             plan.rake_back,
             0.5 * (y.low + y.high) - 0.1},
            roof);
}

std::array<double, 3> door_gaps(const CarPlan& plan) {
  const double fore = plan.size.front() - plan.hood - 0.35, aft = -plan.size.front() + plan.trunk + 0.6;
  return {fore, 0.5 * (fore + aft) - 0.05, aft};
}

Vector3d rim_colour(HostRandom& random) { return random.chance(0.3) ? Vector3d(0.06, 0.06, 0.065) : kChrome; }

RoadUserAppearance make_car(HostRandom& random) {
  ThingBuilder build;
  const CarPlan plan = draw_car(random);
  const bool taxi = random.chance(0.1);
  const Vector3d colour = taxi ? Vector3d(0.78, 0.50, 0.02) : car_paint(random);
  add_car_body(build, plan, coachwork(colour, door_gaps(plan)), rim_colour(random));
  add_car_cabin(build, plan, random.chance(0.12) ? kPlastic : colour);
  if (taxi) {
    build.block({-0.32, 0.32}, {-0.2, 0.0}, {plan.size.height, plan.size.height + 0.14}, lamp({0.85, 0.8, 0.5}, 0.9));
  } else if (plan.size.height > 1.6 && random.chance(0.5)) {
    build.pair({0.5, 0.55}, {-1.2, 0.3}, {plan.size.height - 0.01, plan.size.height + 0.06}, plain(kPlastic));
  }
  return {"Car", build.finish()};
}

RoadUserAppearance make_pickup(HostRandom& random) {
  ThingBuilder build;
  CarPlan plan{
      {random.between(1.92, 2.06), random.between(5.2, 5.9), random.between(1.78, 1.92)}, 1.45, 0, 1.08, 0.55, 0.12};
  const Vector3d colour = car_paint(random);
  plan.trunk = 0.38 * plan.size.length;
  const double half = plan.size.half() - 0.05, rear = -plan.size.front() + 0.06, bed = rear + plan.trunk - 0.05;
  const Material body = coachwork(colour, door_gaps(plan));
  add_car_body(build, plan, body, kChrome);
  add_car_cabin(build, plan, colour);
  build.pair({half - 0.09, half}, {rear, bed}, {plan.belt - 0.02, plan.belt + 0.22}, body);
  build.block({-half, half}, {rear, rear + 0.09}, {plan.belt - 0.02, plan.belt + 0.20}, body);
  build.block({-half + 0.09, half - 0.09}, {rear + 0.09, bed}, {plan.belt - 0.02, plan.belt + 0.01}, plain(kPlastic));
  if (random.chance(0.4)) {  // load
    const double high = plan.belt + random.between(0.2, 0.5);
    build.block({-0.5, 0.45}, {rear + 0.3, bed - 0.4}, {plan.belt, high}, plain({0.30, 0.18, 0.08}));
  }
  return {"Pickup Truck", build.finish()};
}

/// The cab of a truck: upright, with one large pane and a door window on each side.
void add_truck_cab(ThingBuilder& build, const Size& size, double depth, const Vector3d& colour) {
  const double half = size.half() - 0.06, front = size.front() - 0.05, back = front - depth;
  const double sill = 0.42 + 0.38 * size.height;
  build.block({-half, half}, {back, front}, {0.45, sill}, coachwork(colour, {front - 0.25, back + 0.3, back + 0.3}));
  add_cabin(build, {{-half, half}, {back, front}, {sill, size.height}, 0.28, 0.02, back + 0.1}, colour);
  build.pair({half - 0.38, half - 0.05}, {front - 0.05, front + 0.04}, {0.68, 0.88}, lamp(kHeadlight, 1.1));
  build.block({-0.5 * half, 0.5 * half}, {front - 0.05, front + 0.03}, {0.66, sill - 0.12}, plain(kPlastic));
  build.block({-half, half}, {front - 0.3, front + 0.05}, {0.35, 0.58}, plain(kChrome));
  build.pair({half - 0.02, half + 0.06}, {front - 0.35, front - 0.25}, {sill + 0.05, sill + 0.55}, plain(kPlastic));
}

/// The box of a truck: one colour with a band of another around it, and doors with bars at the rear.
Material cargo(const Vector3d& colour, const Vector3d& band, Extent at) {
  return [=](const Spot& spot) -> Surface {
    const double blend = inside(spot.point.z(), at.low, at.high, spot.width(Vector3d::UnitZ()));
    Vector3d paint = mix(colour, band, blend);
    if (spot.normal.y() < -0.9) {
      const double x = std::abs(spot.point.x()), width = spot.width(Vector3d::UnitX());
      const double bars = inside(x, 0, 0.03, width) + inside(x, 0.3, 0.34, width);
      paint = mix(0.8 * colour, kPlastic, std::min(1.0, bars));
    }
    return {paint, Vector3d::Zero(), 0};
  };
}

void add_rear_lights(ThingBuilder& build, const Size& size, double z) {
  const double half = size.half() - 0.06, rear = -size.front();
  build.pair({half - 0.30, half}, {rear, rear + 0.1}, {z, z + 0.14}, lamp(kTaillight, 1.2));
  build.block({-half, half}, {rear + 0.03, rear + 0.15}, {0.42, 0.54}, plain(kPlastic));
  build.block({-0.26, 0.26}, {rear + 0.01, rear + 0.1}, {0.60, 0.72}, plain(kWhite));
}

RoadUserAppearance make_truck(HostRandom& random) {
  ThingBuilder build;
  const Size size{random.between(2.15, 2.4), random.between(6.0, 8.2), random.between(2.7, 3.3)};
  const Vector3d colour = car_paint(random), box = random.chance(0.6) ? kWhite : car_paint(random);
  const double half = size.half() - 0.02, cab = 1.75, front = size.front();
  Size cabin = size;
  cabin.height = std::min(2.35, size.height - 0.2);
  add_truck_cab(build, cabin, cab, colour);
  const Extent bed{-front + 0.04, front - cab - 0.2};
  build.block({-half + 0.3, half - 0.3}, {-front + 0.1, front - 0.5}, {0.42, 0.85}, plain(kPlastic));
  const double band = random.between(1.1, 1.9);
  build.block({-half, half}, bed, {0.85, size.height}, cargo(box, car_paint(random), {band, band + 0.45}));
  add_rear_lights(build, size, 0.66);
  for (const double y : {front - 1.15, -front + 1.5}) build.wheel_pair({half - 0.28, half}, y, 0.45, kChrome);
  return {"Medium-sized Truck", build.finish()};
}

RoadUserAppearance make_semi(HostRandom& random) {
  ThingBuilder build;
  const Size size{2.55, random.between(12.5, 15.5), random.between(3.6, 3.95)};
  const double half = size.half() - 0.03, front = size.front(), tractor = 3.2;
  Size cabin = size;
  cabin.height = 3.0;
  add_truck_cab(build, cabin, 2.0, car_paint(random));
  build.block({-0.45, 0.45}, {-front + 0.5, front - 1.5}, {0.55, 1.05}, plain(kPlastic));
  const Vector3d box = random.chance(0.5) ? kWhite : car_paint(random);
  build.block({-half, half}, {-front + 0.04, front - tractor + 0.5}, {1.15, size.height},
              cargo(box, car_paint(random), {2.0, 2.8}));
  add_rear_lights(build, size, 0.72);
  for (const double y : {front - 1.2, front - 3.4, -front + 1.4, -front + 2.7}) {
    build.wheel_pair({half - 0.3, half}, y, 0.5, kChrome);
  }
  return {"Semi-truck", build.finish()};
}

/// Windows in a row along both sides; doors on the right side alone, a sign over the front pane.
Material bus_coachwork(const Size& size, const Vector3d& colour, const Vector3d& stripe) {
  return [=](const Spot& spot) -> Surface {
    const Vector3d& p = spot.point;
    const double tall = spot.width(Vector3d::UnitZ()), wide = spot.width(Vector3d::UnitX());
    Vector3d paint = mix(colour, stripe, inside(p.z(), 0.75, 1.05, tall));
    double pane = 0;
    Vector3d glow = Vector3d::Zero();
    if (std::abs(spot.normal.x()) > 0.7) {
      const double along = spot.width(Vector3d::UnitY()), from_nose = size.front() - p.y();
      pane = inside(p.z(), 1.25, 2.25, tall) * stripes(p.y(), 1.45, 1.25, along) *
             inside(p.y(), -size.front() + 0.5, size.front() - 0.3, along);
      const double doors = inside(from_nose, 0.4, 1.6, along) + inside(from_nose, 5.0, 6.4, along);
      if (spot.normal.x() > 0) pane = std::max(pane, std::min(1.0, doors) * inside(p.z(), 0.5, 2.35, tall));
      glow = 0.35 * pane * Vector3d(0.8, 0.75, 0.6);
    } else if (spot.normal.y() > 0.7) {
      const double middle = inside(p.x(), -size.half() + 0.15, size.half() - 0.15, wide);
      pane = middle * inside(p.z(), 1.0, 2.35, tall);
      const double sign = middle * inside(p.z(), 2.45, 2.78, tall);
      paint = mix(paint, Vector3d(0.02, 0.02, 0.02), sign);
      const double letters = sign * inside(p.z(), 2.54, 2.69, tall) * stripes(p.x(), 0.3, 0.2, wide);
      paint = mix(paint, Vector3d(0.8, 0.42, 0.05), letters);
      glow = letters * Vector3d(0.8, 0.42, 0.05);
    } else if (spot.normal.y() < -0.7) {
      pane = inside(p.x(), -0.7, 0.7, wide) * inside(p.z(), 1.55, 2.3, tall);
    }
    return {mix(paint, {0.025, 0.032, 0.04}, pane), glow, 0.03 + 0.12 * pane};
  };
}

RoadUserAppearance make_bus(HostRandom& random) {
  ThingBuilder build;
  const Size size{2.55, random.between(9.5, 12), random.between(3.0, 3.2)};
  const double half = size.half() - 0.03, front = size.front() - 0.04;
  const Vector3d colour = random.chance(0.5) ? kWhite : car_paint(random);
  build.block({-half, half}, {-front, front}, {0.32, size.height - 0.18},
              bus_coachwork({2 * half, 2 * front, size.height}, colour, car_paint(random)));
  build.block({-0.9, 0.9}, {-front + 0.6, -front + 3.2}, {size.height - 0.2, size.height}, plain(0.7 * colour));
  build.pair({half - 0.45, half - 0.08}, {front - 0.1, front + 0.04}, {0.55, 0.75}, lamp(kHeadlight, 1.1));
  build.pair({half - 0.25, half}, {-front - 0.04, -front + 0.1}, {0.7, 1.3}, lamp(kTaillight, 1.2));
  for (const double y : {front - 2.5, -front + 3.0}) build.wheel_pair({half - 0.28, half + 0.02}, y, 0.48, kChrome);
  build.pair({half - 0.06, half + 0.03}, {front - 0.2, front - 0.1}, {1.9, 2.4}, plain(kPlastic));
  return {"Bus", build.finish()};
}

/// A wheel loader: engine at the rear, cab in the middle, bucket in front; ladder and exhaust on one side each.
RoadUserAppearance make_loader(HostRandom& random) {
  ThingBuilder build;
  const double scale = random.between(0.85, 1.1);
  const Vector3d colour = random.chance(0.7) ? Vector3d(0.72, 0.42, 0.02) : Vector3d(0.62, 0.16, 0.02);
  const auto range = [&](double low, double high) { return Extent{scale * low, scale * high}; };
  build.tapered(range(-0.85, 0.85), range(-2.9, -0.6), range(0.9, 1.95), {0.1, range(-2.7, -0.6)}, plain(colour, 0.03));
  build.block(range(-0.6, 0.6), range(-2.95, -2.8), range(1.0, 1.7), plain(kPlastic));
  add_cabin(build, {range(-0.75, 0.75), range(-0.65, 0.75), range(1.2, 3.1), 0.12, 0.08, scale * 0.05}, colour);
  build.block(range(-0.5, 0.5), range(-0.6, 1.7), range(0.7, 1.25), plain(0.8 * colour));
  build.pair(range(0.42, 0.58), range(0.9, 2.7), range(0.8, 1.15), plain(colour));
  build.tapered(range(-1.25, 1.25), range(2.5, 3.3), range(0.25, 1.15), {0, range(2.5, 2.75)},
                plain({0.20, 0.20, 0.20}));
  build.block(range(0.45, 0.55), range(-1.6, -1.5), range(1.9, 2.6), plain(kPlastic));
  build.block(range(-1.0, -0.85), range(-0.5, 0.0), range(0.5, 1.25), plain(kPlastic));
  build.block(range(-0.12, 0.12), range(-0.3, -0.1), range(3.1, 3.25), lamp(kOrange, 1.0));
  for (const double y : {1.25, -1.65}) {
    build.wheel_pair(range(0.75, 1.25), scale * y, scale * 0.72, {0.72, 0.42, 0.02});
  }
  build.pair(range(0.55, 0.8), range(0.7, 0.82), range(1.9, 2.1), lamp(kHeadlight, 0.8));
  return {"Other Vehicle - Construction Vehicle", build.finish()};
}

/// Red and blue across the roof.
void add_light_bar(ThingBuilder& build, double y, double z) {
  build.block({-0.6, -0.04}, {y - 0.14, y + 0.14}, {z, z + 0.13}, lamp({0.75, 0.03, 0.03}, 1.3));
  build.block({0.04, 0.6}, {y - 0.14, y + 0.14}, {z, z + 0.13}, lamp({0.03, 0.08, 0.8}, 1.3));
  build.block({-0.04, 0.04}, {y - 0.12, y + 0.12}, {z, z + 0.1}, plain(kWhite));
}

/// Black with white doors.
void make_police_car(ThingBuilder& build, HostRandom& random) {
  CarPlan plan{{1.9, random.between(4.9, 5.2), 1.52}, 1.4, 0.95, 0.94, 0.8, 0.6};
  const auto doors = door_gaps(plan);
  const Material black = coachwork({0.03, 0.03, 0.035}, doors), white = coachwork(kWhite, doors);
  const Material body = [=](const Spot& spot) {
    const bool door = std::abs(spot.normal.x()) > 0.7 && spot.point.y() > doors[2] && spot.point.y() < doors[0];
    return door ? white(spot) : black(spot);
  };
  add_car_body(build, plan, body, kChrome);
  add_car_cabin(build, plan, kWhite);
  add_light_bar(build, -0.2, plan.size.height - 0.01);
}

/// A white van with a coloured stripe, or a red one.
void make_rescue_van(ThingBuilder& build, HostRandom& random) {
  const bool red = random.chance(0.4);
  const Size size{2.2, random.between(6.0, 7.4), random.between(2.6, 3.0)};
  const double half = size.half() - 0.02, front = size.front(), cab = 1.9;
  const Vector3d colour = red ? Vector3d(0.52, 0.02, 0.02) : kWhite, stripe = red ? kWhite : Vector3d(0.65, 0.05, 0.02);
  Size cabin = size;
  cabin.height = 2.25;
  add_truck_cab(build, cabin, cab, colour);
  build.block({-half, half}, {-front + 0.04, front - cab + 0.05}, {0.45, size.height},
              cargo(colour, stripe, {1.15, 1.45}));
  add_rear_lights(build, size, 0.8);
  add_light_bar(build, front - 1.1, 2.24);
  for (const double y : {front - 1.15, -front + 1.3}) build.wheel_pair({half - 0.25, half}, y, 0.42, kChrome);
}

RoadUserAppearance make_emergency(HostRandom& random) {
  ThingBuilder build;
  random.chance(0.5) ? make_police_car(build, random) : make_rescue_van(build, random);
  return {"Emergency Vehicle", build.finish()};
}

}  // namespace

RoadUserAppearance make_road_user(RoadUser kind, HostRandom& random) {
  constexpr std::array vehicles{make_car, make_pickup, make_truck, make_semi, make_bus, make_loader, make_emergency};
  const auto index = static_cast<std::size_t>(kind);  // riders come after vehicles
  return index < vehicles.size() ? vehicles[index](random) : make_rider(kind, random);
}

}  // namespace cloam
