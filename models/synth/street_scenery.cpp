// See street_scenery.h.
#include "models/synth/street_scenery.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "models/synth/thing_builder.h"

namespace cloam {
namespace {

using Eigen::Vector3d;

const Vector3d kX = Vector3d::UnitX(), kY = Vector3d::UnitY(), kZ = Vector3d::UnitZ();
const Vector3d kPaint(0.62, 0.62, 0.60), kYellow(0.62, 0.42, 0.05), kConcrete(0.33, 0.32, 0.30);

Surface matt(const Vector3d& albedo) { return {albedo, Vector3d::Zero(), 0}; }

/// Noise of features of `size` metres, 0 on average, that fades where a sample covers them.
double mottle(const Vector3d& p, double size, double width) {
  const double fade = 1 - width / size;
  return fade > 0 ? fade * (noise(p / size) - 0.5) : 0;
}

double line(double x, double middle, double breadth, double width) {
  return inside(x, middle - 0.5 * breadth, middle + 0.5 * breadth, width);
}

struct Widths {
  double x = 0, y = 0;
  double larger() const { return std::max(x, y); }
};

Vector3d road(const StreetPlan& plan, const Vector3d& p, const Widths& width) {
  const double side = std::abs(p.x());
  const double patches = 0.35 * mottle(p, 3.5, width.larger()) + 0.3 * mottle(p, 0.7, width.larger());
  Vector3d colour = (1 + patches) * Vector3d(0.105, 0.105, 0.11);
  colour = mix(colour, 1.35 * colour, inside(side, plan.parking_edge(), plan.kerb(), width.x));
  colour = mix(colour, kConcrete, inside(side, plan.kerb() - 0.35, plan.kerb() + 1, width.x));
  double white = line(side, plan.lane_edge(), 0.14, width.x);
  const double dashes = stripes(p.y(), 6, 2.6, width.y);
  if (plan.lanes == 2) white += dashes * line(side, 3.5, 0.14, width.x);
  if (plan.lanes == 1) white += dashes * line(side, 0, 0.14, width.x);
  const double lots =
      stripes(p.y(), 6.4, 0.12, width.y) * inside(side, plan.parking_edge(), plan.kerb() - 0.35, width.x);
  white += line(side, plan.parking_edge(), 0.12, width.x) + lots;
  const double zebra = inside(p.y(), plan.crossing, plan.crossing + 3, width.y);
  white = std::max(white * (1 - zebra), zebra * stripes(p.x() + 0.25, 1.0, 0.5, width.x));
  if (plan.lanes == 2) colour = mix(colour, kYellow, (1 - zebra) * line(side, 0.16, 0.12, width.x));
  return mix(colour, kPaint, 0.9 * std::min(1.0, white));
}

Vector3d beside(const StreetPlan& plan, const Vector3d& p, const Widths& width) {
  const double side = std::abs(p.x());
  Vector3d slabs = (1 + 0.2 * mottle(p, 2.5, width.larger())) * Vector3d(0.30, 0.29, 0.275);
  const double joints = std::max(stripes(p.y(), 1.6, 0.06, width.y), stripes(side - plan.kerb(), 1.2, 0.06, width.x));
  slabs = mix(slabs, 0.6 * slabs, joints);
  slabs = mix(slabs, {0.42, 0.41, 0.39}, inside(side, plan.kerb(), plan.kerb() + 0.22, width.x));
  const Vector3d lawn = (1 + 0.5 * mottle(p, 1.8, width.larger())) * Vector3d(0.075, 0.135, 0.035);
  const bool grass = lattice_value(static_cast<int>(std::floor(p.y() / 14)), p.x() > 0, 3) < plan.grass;
  const double behind = inside(side, plan.pavement(), 1e6, width.x);
  return mix(slabs, grass ? lawn : 0.8 * slabs, behind);
}

struct Facade {
  Vector3d wall, trim, shop;
  double period = 3, storey = 3.1, pane = 1.5, rise = 1.6;
  double ground_floor = 3.8;
  double height = 12;
  int number = 0;  // of the building: which windows are lit
};

Surface facade_at(const Facade& facade, const Spot& spot) {
  const Vector3d& p = spot.point;
  const bool front = std::abs(spot.normal.y()) > 0.5;
  const double across = front ? p.x() : p.y(), wide = spot.width(front ? kX : kY), tall = spot.width(kZ);
  if (spot.normal.z() > 0.5) return matt({0.16, 0.155, 0.15});
  const double up = p.z() - facade.ground_floor;
  Vector3d wall = (1 + 0.15 * mottle({across, p.z(), 0}, 4, wide)) * facade.wall;
  wall = mix(wall, facade.trim, 0.8 * inside(up, -0.35, 0, tall));
  double pane = 0, lit = 0;
  if (up > 0) {
    const double top = facade.height - facade.ground_floor - 0.9;
    const double columns = stripes(across - 0.5 * (facade.period - facade.pane), facade.period, facade.pane, wide),
                 rows = stripes(up - 0.75, facade.storey, facade.rise, tall) * inside(up, 0, top, tall);
    pane = columns * rows;
    const double sill = stripes(up - 0.6, facade.storey, 0.15, tall) * inside(up, 0, top, tall);
    wall = mix(wall, facade.trim, 0.7 * sill * columns);
    const int column = static_cast<int>(std::floor(across / facade.period)) + (front ? 100 : 300),
              row = static_cast<int>(std::floor(up / facade.storey));
    const double far = std::clamp(wide / facade.period, 0.0, 1.0);
    lit = (1 - far) * (lattice_value(column, row, facade.number) > 0.62) + far * 0.38;
  } else {
    pane = stripes(across, 3.6, 2.7, wide) * inside(p.z(), 0.6, 2.9, tall);
    wall = mix(wall, facade.shop, inside(p.z(), 2.9, facade.ground_floor - 0.35, tall));
    lit = lattice_value(static_cast<int>(std::floor(across / 7.2)), 0, facade.number) > 0.5 ? 0.8 : 0.1;
  }
  const Vector3d lamplight = mix({0.80, 0.56, 0.26}, {0.62, 0.62, 0.58}, lattice_value(facade.number, 1, 2));
  return {mix(wall, {0.05, 0.06, 0.075}, pane), pane * lit * lamplight, 0.13 * pane};
}

Vector3d wall_colour(HostRandom& random) {
  static const std::array<Vector3d, 10> walls{{{0.42, 0.17, 0.11},
                                               {0.52, 0.44, 0.32},
                                               {0.55, 0.53, 0.48},
                                               {0.33, 0.33, 0.34},
                                               {0.60, 0.50, 0.26},
                                               {0.30, 0.40, 0.44},
                                               {0.48, 0.28, 0.22},
                                               {0.38, 0.43, 0.33},
                                               {0.62, 0.58, 0.55},
                                               {0.45, 0.33, 0.42}}};
  return random.between(0.85, 1.12) * walls[std::size_t(random.one_of(walls.size()))];
}

}  // namespace

Material ground_material(const StreetPlan& plan) {
  return [plan](const Spot& spot) -> Surface {
    if (spot.normal.z() < 0.5) return matt({0.36, 0.35, 0.33});  // the kerb's face
    const Widths width{spot.width(kX), spot.width(kY)};
    const Vector3d flat(spot.point.x(), spot.point.y(), 0);
    return matt(std::abs(spot.point.x()) < plan.kerb() ? road(plan, flat, width) : beside(plan, flat, width));
  };
}

std::shared_ptr<const Thing> make_building(const BuildingShape& shape, HostRandom& random) {
  ThingBuilder build;
  Facade facade;
  facade.wall = wall_colour(random);
  facade.trim = mix(facade.wall, {0.7, 0.68, 0.64}, random.between(0.4, 0.8));
  facade.shop = mix(wall_colour(random), {0.3, 0.05, 0.05}, random.between(0, 0.6));
  facade.period = random.between(2.3, 3.6);
  facade.pane = facade.period * random.between(0.42, 0.68);
  facade.storey = random.between(2.9, 3.4);
  facade.rise = random.between(1.3, 1.9);
  facade.height = shape.height;
  facade.number = random.one_of(1 << 20);
  const Material walls = [facade](const Spot& spot) { return facade_at(facade, spot); };
  const Extent x{-0.5 * shape.width, 0.5 * shape.width}, y{-0.5 * shape.depth, 0.5 * shape.depth};
  build.block(x, y, {0, shape.height}, walls);
  if (shape.height < 8 && random.chance(0.7)) {
    const Vector3d tiles = random.chance(0.6) ? Vector3d(0.26, 0.09, 0.06) : Vector3d(0.10, 0.10, 0.12);
    build.tapered(x.grown(0.3), y.grown(0.3), {shape.height, shape.height + 0.3 * shape.depth}, {0.6, {-0.05, 0.05}},
                  plain(tiles));
  } else {
    build.block(x.grown(0.18), y.grown(0.18), {shape.height - 0.5, shape.height + 0.25}, plain(facade.trim));
    const double at = random.between(-0.25, 0.25) * shape.width;
    build.block({at - 1.5, at + 1.5}, {-1.5, 1.5}, {shape.height, shape.height + 2.2}, plain(0.8 * facade.wall));
  }
  return build.finish();
}

std::shared_ptr<const Thing> make_tree(HostRandom& random) {
  ThingBuilder build;
  const double trunk = random.between(2.2, 3.0), radius = random.between(1.0, 1.5);
  const Vector3d green = mix({0.06, 0.16, 0.03}, {0.16, 0.19, 0.04}, random.between(0, 1));
  const double seed = random.between(0, 100);
  const Material leaves = [=](const Spot& spot) {
    const double dapple = 0.8 * mottle(spot.point + Vector3d::Constant(seed), 0.45, spot.across);
    return matt((1 + dapple) * green);
  };
  build.pillar({0, 0}, {0, trunk + 0.5}, {0.17, 0.10}, plain({0.14, 0.09, 0.06}));
  if (random.chance(0.3)) {
    build.pillar({0, 0}, {trunk - 0.9, trunk + 4}, {radius, 0.05}, leaves);
    return build.finish();
  }
  build.sphere({0, 0, trunk + radius}, radius, leaves);
  for (int i = 0; i < 3; ++i) {
    const double angle = 2 * M_PI * (i + random.between(0, 1)) / 3, away = 0.6 * radius;
    build.sphere({away * std::cos(angle), away * std::sin(angle), trunk + radius * random.between(0.7, 1.5)},
                 radius * random.between(0.55, 0.75), leaves);
  }
  return build.finish();
}

std::shared_ptr<const Thing> make_street_lamp() {
  ThingBuilder build;
  const Material metal = plain({0.16, 0.18, 0.18});
  build.pillar({0, 0}, {0, kLampHeight}, {0.10, 0.06}, metal);
  build.block({-0.05, 0.05}, {-0.05, kLampReachOut + 0.3}, {kLampHeight - 0.05, kLampHeight + 0.05}, metal);
  build.block({-0.14, 0.14}, {kLampReachOut - 0.35, kLampReachOut + 0.35}, {kLampHeight - 0.16, kLampHeight - 0.04},
              lamp({0.85, 0.78, 0.6}, 1.4));
  return build.finish();
}

std::shared_ptr<const Thing> make_furniture(HostRandom& random) {
  ThingBuilder build;
  const int kind = random.one_of(3);
  if (kind == 0) {
    const double seed = random.between(0, 100), half = random.between(1.5, 4);
    build.tapered({-half, half}, {-0.4, 0.4}, {0, random.between(0.7, 1.3)}, {0.1, {-0.3, 0.3}}, [=](const Spot& spot) {
      const double dapple = 0.7 * mottle(spot.point + Vector3d::Constant(seed), 0.3, spot.across);
      return matt((1 + dapple) * Vector3d(0.05, 0.12, 0.03));
    });
  } else if (kind == 1) {
    build.pillar({0, 0}, {0, 1.0}, {0.25, 0.3}, plain({0.05, 0.12, 0.08}));
  } else {
    build.block({-0.25, 0.25}, {-0.22, 0.22}, {0.1, 1.25}, plain({0.05, 0.09, 0.30}));
    build.block({-0.2, 0.2}, {-0.17, 0.17}, {0, 0.1}, plain({0.05, 0.05, 0.05}));
  }
  return build.finish();
}

}  // namespace cloam
