// A made street as rays see it: things of several solids, actors that move along the street, sun with hard shadows or
// lamps at night, fog. World frame right-handed, z up, metres; street coordinates are metres along the middle line and
// metres to the right of it. Host code in double.
#pragma once
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "models/synth/box_tree.h"
#include "models/synth/ray_cast.h"

namespace cloam {

/// Where a sample of a picture meets a surface, in the frame of the thing.
struct Spot {
  Eigen::Vector3d point, normal;
  Eigen::Vector3d view;  // direction of the ray
  double across = 0;     // metres that the sample covers across the ray

  /// Metres that the sample covers along a unit axis of the surface: patterns finer than that turn into their mean.
  double width(const Eigen::Vector3d& axis) const;
};

struct Surface {
  Eigen::Vector3d albedo;                          // linear RGB
  Eigen::Vector3d glow = Eigen::Vector3d::Zero();  // light that it gives off at night
  double gloss = 0;                                // how much of the sky it mirrors
};
using Material = std::function<Surface(const Spot&)>;

struct Part {
  std::shared_ptr<const Solid> solid;
  Material material;
};

/// Solids in one frame: x right, y forward, z up from the ground.
struct Thing {
  std::vector<Part> parts;
  Eigen::AlignedBox3d bounds;

  void add(std::shared_ptr<const Solid> solid, Material material);
  /// What it turns about: the middle of its bounds, on the ground.
  Eigen::Vector3d pivot() const { return {bounds.center().x(), bounds.center().y(), 0}; }
};

struct PlacedThing {
  std::shared_ptr<const Thing> thing;
  Eigen::Vector3d position;  // of its pivot
  Eigen::Vector2d turn;      // cosine and sine of its yaw: counter-clockwise, 0 looks along the world's y
  int actor = 0;             // number in the truth, 0 for what is no actor
  bool lit = true;           // at night

  Ray to_thing(const Ray& ray) const;
};

/// The course of a street; its road is level, pavements lie one step higher. A straight line or an arc that starts at
/// the origin along the world's y.
struct Course {
  double curvature = 0;          // to the left, 1/m
  double kerb = 9, step = 0.14;  // metres from the middle to the kerbs, and their height
  Eigen::Vector2d place(double along, double right) const;
  double yaw(double along) const { return curvature * along; }
  /// (along, right) of a place.
  Eigen::Vector2d coordinates(const Eigen::Vector2d& place) const;
  double ground(double right) const { return std::abs(right) < kerb ? 0 : step; }
};

/// Goes evenly along the street.
struct Track {
  double along = 0, right = 0;  // at time 0
  double speed = 0;             // m/s along the street
  double turn = 0;              // against the street's direction
};

struct StreetActor {
  std::string id, label;
  std::shared_ptr<const Thing> thing;
  Track track;
  bool parked = false;

  /// Turned by `turn` radians more.
  PlacedThing at(const Course& course, double time, double turn, int number) const;
};

struct Light {
  bool night = false;
  Eigen::Vector3d to_sun = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d sun, sky, bounce;    // linear RGB on a white surface that faces it
  Eigen::Vector3d zenith, horizon;     // of the sky as seen
  Eigen::Vector3d glare;               // of the sky around the sun
  std::vector<Eigen::Vector3d> lamps;  // lit at night
};

struct Sighting {
  double distance = 0;
  Eigen::Vector3d normal;  // in the world frame
  int actor = 0;
  Surface surface;
};

/// Things that stand where they are.
class ThingSet {
 public:
  explicit ThingSet(std::vector<PlacedThing> things);

  struct Hit {
    RayHit ray;  // in the thing's frame
    const PlacedThing* placed = nullptr;
    const Part* part = nullptr;
  };
  /// The nearest before `limit`.
  std::optional<Hit> nearest(const Ray& ray, double limit) const;
  bool blocked(const Ray& ray, double limit) const;

 private:
  std::vector<PlacedThing> things_;
  BoxTree tree_;
};

struct StreetWorld {
  Course course;
  Light light;
  Material ground;  // asked in street coordinates: x right, y along
  std::shared_ptr<const ThingSet> scenery;
  std::vector<StreetActor> actors;
};

/// The street at one time.
class StreetMoment {
 public:
  /// Actors are turned by `turn` radians about their own z axes.
  StreetMoment(const StreetWorld& street, double time, double turn = 0);

  /// `across`: metres that a sample covers at a distance of one metre.
  std::optional<Sighting> nearest(const Ray& ray, double across) const;
  /// What a camera sees along the ray: linear RGB, not clamped.
  Eigen::Vector3d colour(const Ray& ray, double across) const;

 private:
  Eigen::Vector3d light_at(const Eigen::Vector3d& point, const Eigen::Vector3d& normal) const;

  const StreetWorld& street_;
  ThingSet actors_;
};

}  // namespace cloam
