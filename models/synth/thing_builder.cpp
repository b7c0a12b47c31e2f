// See thing_builder.h.
#include "models/synth/thing_builder.h"

#include <cmath>
#include <utility>

#include "models/synth/procedural.h"

namespace cloam {

using Eigen::Vector2d;
using Eigen::Vector3d;

Material plain(const Vector3d& colour, double gloss) {
  return [=](const Spot&) { return Surface{colour, Vector3d::Zero(), gloss}; };
}

Material glass() { return plain({0.025, 0.032, 0.04}, 0.16); }

Material lamp(const Vector3d& colour, double glow) {
  return [=](const Spot&) { return Surface{colour, glow * colour, 0}; };
}

Material wheel_material(const Vector2d& axle, double radius, const Vector3d& rim) {
  return [=](const Spot& spot) -> Surface {
    const Vector2d arm = Vector2d(spot.point.y(), spot.point.z()) - axle;
    const double blend = inside(arm.norm() / radius, 0, 0.62, spot.across / radius);
    const double spokes = 0.75 + 0.25 * std::cos(5 * std::atan2(arm.y(), arm.x()));
    const bool outer_face = std::abs(spot.normal.x()) > 0.5;
    return {mix({0.022, 0.022, 0.024}, spokes * rim, outer_face ? blend : 0), Vector3d::Zero(), 0};
  };
}

void ThingBuilder::block(Extent x, Extent y, Extent z, const Material& material) { tapered(x, y, z, {0, y}, material); }

void ThingBuilder::pair(Extent x, Extent y, Extent z, const Material& material) {
  block(x, y, z, material);
  block({-x.high, -x.low}, y, z, material);
}

void ThingBuilder::tapered(Extent x, Extent y, Extent z, const Roof& roof, const Material& material) {
  TaperedShape shape;
  shape.bottom = {Vector2d(x.low, y.low), Vector2d(x.high, y.high)};
  shape.top = {Vector2d(x.low + roof.inset, roof.y.low), Vector2d(x.high - roof.inset, roof.y.high)};
  shape.low = z.low;
  shape.high = z.high;
  add(make_tapered(shape), material);
}

void ThingBuilder::sphere(const Vector3d& centre, double radius, const Material& material) {
  add(make_placed(make_sphere(radius), centre, Eigen::Matrix3d::Identity()), material);
}

void ThingBuilder::wheel(Extent x, double y, double radius, const Vector3d& rim) {
  const double half = 0.5 * (x.high - x.low);
  const Eigen::Matrix3d axis_to_x = Eigen::AngleAxisd(0.5 * M_PI, Vector3d::UnitY()).toRotationMatrix();
  auto disc = make_revolution({{0, -half}, {radius, -half}, {radius, half}, {0, half}});
  add(make_placed(std::move(disc), {0.5 * (x.low + x.high), y, radius}, axis_to_x),
      wheel_material({y, radius}, radius, rim));
}

void ThingBuilder::wheel_pair(Extent x, double y, double radius, const Vector3d& rim) {
  wheel(x, y, radius, rim);
  wheel({-x.high, -x.low}, y, radius, rim);
}

void ThingBuilder::pillar(const Vector2d& foot, Extent z, Extent radius, const Material& material) {
  auto solid = make_revolution({{0, z.low}, {radius.low, z.low}, {radius.high, z.high}, {0, z.high}});
  add(make_placed(std::move(solid), {foot.x(), foot.y(), 0}, Eigen::Matrix3d::Identity()), material);
}

std::shared_ptr<const Thing> ThingBuilder::finish() { return std::make_shared<Thing>(std::exchange(thing_, {})); }

}  // namespace cloam
