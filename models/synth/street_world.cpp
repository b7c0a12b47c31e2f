// See street_world.h.
#include "models/synth/street_world.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "models/synth/procedural.h"

namespace cloam {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kSurfaceOffset = 1e-5;  // how far a shadow ray starts from its surface
constexpr double kHorizon = 1000;        // metres; beyond is sky
constexpr double kFog = 600;             // metres after which 1 - 1/e of the light is the fog's
constexpr double kLampReach = 28;
const Vector3d kLampLight(17, 12.5, 7.5);

Vector3d turned(const Vector2d& turn, const Vector3d& v) {
  return {turn.x() * v.x() - turn.y() * v.y(), turn.y() * v.x() + turn.x() * v.y(), v.z()};
}
Vector3d turned_back(const Vector2d& turn, const Vector3d& v) { return turned({turn.x(), -turn.y()}, v); }
Vector2d turn_of(double yaw) { return {std::cos(yaw), std::sin(yaw)}; }

std::vector<Eigen::AlignedBox3d> boxes_of(const std::vector<PlacedThing>& things) {
  std::vector<Eigen::AlignedBox3d> boxes;
  for (const PlacedThing& placed : things) {
    Eigen::AlignedBox3d box;
    for (int corner = 0; corner < 8; ++corner) {
      const auto type = static_cast<Eigen::AlignedBox3d::CornerType>(corner);
      box.extend(placed.position + turned(placed.turn, placed.thing->bounds.corner(type) - placed.thing->pivot()));
    }
    boxes.push_back(box);
  }
  return boxes;
}

struct GroundHit {
  double distance = 0;
  Vector2d place;   // (along, right)
  Vector3d normal;  // in the world frame
};

// Two levels with an upright step between them at the kerbs.
std::optional<GroundHit> hit_ground(const Course& course, const Ray& ray) {
  if (ray.direction.z() >= -1e-9) return std::nullopt;
  const auto coordinates = [&](double distance) {
    return course.coordinates((ray.origin + distance * ray.direction).head<2>());
  };
  double high = (course.step - ray.origin.z()) / ray.direction.z(), low = -ray.origin.z() / ray.direction.z();
  if (low <= 0 || low > kHorizon) return std::nullopt;
  const Vector2d above = coordinates(high), below = coordinates(low);
  if (high > 0 && std::abs(above.y()) >= course.kerb) return GroundHit{high, above, Vector3d::UnitZ()};
  if (std::abs(below.y()) <= course.kerb) return GroundHit{low, below, Vector3d::UnitZ()};
  // Through the step: where between the two levels is it as far from the middle as the kerb?
  for (int halving = 0; halving < 20; ++halving) {
    const double middle = 0.5 * (high + low);
    (std::abs(coordinates(middle).y()) < course.kerb ? high : low) = middle;
  }
  const Vector2d place = coordinates(low);
  const double yaw = course.yaw(place.x()), side = place.y() > 0 ? -1 : 1;
  return GroundHit{low, place, side * Vector3d(std::cos(yaw), std::sin(yaw), 0)};
}

Vector3d sky(const Light& light, const Vector3d& direction) {
  const double up = std::clamp(direction.z(), 0.0, 1.0);
  Vector3d colour = mix(light.horizon, light.zenith, std::sqrt(up));
  return colour + std::pow(std::max(0.0, direction.dot(light.to_sun)), 24) * light.glare;
}

}  // namespace

double Spot::width(const Vector3d& axis) const {
  const double facing = view.dot(normal), cosine = std::max(std::abs(facing), 0.03);
  const Vector3d slope = view - facing * normal;
  const double length = slope.norm();
  const double along = length > 1e-9 ? std::abs(axis.dot(slope)) / length : 0;
  return across * (1 + (1 / cosine - 1) * along);
}

Ray PlacedThing::to_thing(const Ray& ray) const {
  return {turned_back(turn, ray.origin - position) + thing->pivot(), turned_back(turn, ray.direction)};
}

void Thing::add(std::shared_ptr<const Solid> solid, Material material) {
  bounds.extend(solid->bounds());
  parts.push_back({std::move(solid), std::move(material)});
}

Vector2d Course::place(double along, double right) const {
  const double yaw = curvature * along;
  // Of the middle line: the integral of (-sin, cos), without loss of digits near a curvature of 0.
  const double chord = std::abs(yaw) < 1e-9 ? along : 2 * std::sin(0.5 * yaw) / curvature;
  return Vector2d(-chord * std::sin(0.5 * yaw), chord * std::cos(0.5 * yaw)) +
         right * Vector2d(std::cos(yaw), std::sin(yaw));
}

Vector2d Course::coordinates(const Vector2d& p) const {
  const double x = 1 + curvature * p.x(), y = curvature * p.y();
  const double along = std::abs(curvature) < 1e-9 ? p.y() : std::atan2(y, x) / curvature;
  return {along, (2 * p.x() + curvature * p.squaredNorm()) / (1 + std::hypot(x, y))};
}

PlacedThing StreetActor::at(const Course& course, double time, double turn, int number) const {
  const double along = track.along + time * track.speed;
  const Vector2d place = course.place(along, track.right);
  return {thing,
          {place.x(), place.y(), course.ground(track.right)},
          turn_of(course.yaw(along) + track.turn + turn),
          number,
          !parked};
}

ThingSet::ThingSet(std::vector<PlacedThing> things) : things_(std::move(things)), tree_(boxes_of(things_)) {}

std::optional<ThingSet::Hit> ThingSet::nearest(const Ray& ray, double limit) const {
  std::optional<Hit> best;
  tree_.along(ray, limit, [&](std::size_t i) {
    const PlacedThing& placed = things_[i];
    const Ray local = placed.to_thing(ray);
    for (const Part& part : placed.thing->parts) {
      const auto hit = part.solid->hit(local, 0);
      if (hit && hit->distance < limit) limit = hit->distance, best = Hit{*hit, &placed, &part};
    }
  });
  return best;
}

bool ThingSet::blocked(const Ray& ray, double limit) const {
  double open = limit;
  tree_.along(ray, open, [&](std::size_t i) {
    const PlacedThing& placed = things_[i];
    const Ray local = placed.to_thing(ray);
    for (const Part& part : placed.thing->parts) {
      if (open < 0) return;
      const auto hit = part.solid->hit(local, 0);
      if (hit && hit->distance < limit) open = -1;
    }
  });
  return open < 0;
}

StreetMoment::StreetMoment(const StreetWorld& street, double time, double turn)
    : street_(street), actors_([&] {
        std::vector<PlacedThing> placed;
        for (std::size_t i = 0; i < street.actors.size(); ++i) {
          placed.push_back(street.actors[i].at(street.course, time, turn, static_cast<int>(i) + 1));
        }
        return placed;
      }()) {}

std::optional<Sighting> StreetMoment::nearest(const Ray& ray, double across) const {
  const auto ground = hit_ground(street_.course, ray);
  double limit = ground ? ground->distance : kHorizon;
  std::optional<ThingSet::Hit> best = street_.scenery->nearest(ray, limit);
  if (best) limit = best->ray.distance;
  if (const auto actor = actors_.nearest(ray, limit)) best = actor;
  if (best) {
    const PlacedThing& placed = *best->placed;
    const double distance = best->ray.distance;
    const Ray local = placed.to_thing(ray);
    const Spot spot{local.origin + distance * local.direction, best->ray.normal, local.direction, across * distance};
    Sighting seen{distance, turned(placed.turn, best->ray.normal), placed.actor, best->part->material(spot)};
    if (!placed.lit) seen.surface.glow.setZero();
    return seen;
  }
  if (!ground) return std::nullopt;
  const Vector2d turn = turn_of(street_.course.yaw(ground->place.x()));
  const double height = ray.origin.z() + ground->distance * ray.direction.z();
  const Spot spot{{ground->place.y(), ground->place.x(), height},
                  turned_back(turn, ground->normal),
                  turned_back(turn, ray.direction),
                  across * ground->distance};
  return Sighting{ground->distance, ground->normal, 0, street_.ground(spot)};
}

Vector3d StreetMoment::light_at(const Vector3d& point, const Vector3d& normal) const {
  const Light& light = street_.light;
  const Vector3d start = point + kSurfaceOffset * normal;
  const double up = 0.5 + 0.5 * normal.z();
  Vector3d sum = up * light.sky + (1 - up) * light.bounce;
  // What stands close above the ground takes the sky's light from it.
  const bool covered = normal.z() > 0.9 && point.z() < 0.3 && actors_.blocked({start, Vector3d::UnitZ()}, 2.5);
  if (covered) sum *= 0.35;
  const double sun = normal.dot(light.to_sun);
  if (!light.night && sun > 0 && !covered) {
    const Ray to_sun{start, light.to_sun};
    if (!actors_.blocked(to_sun, kHorizon) && !street_.scenery->blocked(to_sun, kHorizon)) sum += sun * light.sun;
  }
  for (const Vector3d& lamp : light.lamps) {
    const Vector3d way = lamp - point;
    const double distance = way.norm();
    const double fade = std::max(0.0, 1 - distance / kLampReach);
    const double facing = std::max(0.0, normal.dot(way)) / distance;
    sum += (covered ? 0.2 : 1.0) * fade * (0.2 + 0.8 * facing) / (12 + distance * distance) * kLampLight;
  }
  return sum;
}

Vector3d StreetMoment::colour(const Ray& ray, double across) const {
  const Light& light = street_.light;
  const auto seen = nearest(ray, across);
  if (!seen) return sky(light, ray.direction);
  const Vector3d point = ray.origin + seen->distance * ray.direction;
  Vector3d colour = seen->surface.albedo.cwiseProduct(light_at(point, seen->normal));
  if (light.night) colour += seen->surface.glow;
  if (seen->surface.gloss > 0) {
    const Vector3d mirrored = ray.direction - 2 * ray.direction.dot(seen->normal) * seen->normal;
    colour += seen->surface.gloss * sky(light, mirrored);
  }
  const double fog = 1 - std::exp(-seen->distance / kFog);
  return mix(colour, light.horizon, fog);
}

}  // namespace cloam
