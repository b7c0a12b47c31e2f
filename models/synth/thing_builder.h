// Materials and blocks that the things of a made street are put together from.
#pragma once
#include "models/synth/street_world.h"

namespace cloam {

struct Extent {
  double low = 0, high = 0;
  Extent grown(double margin) const { return {low - margin, high + margin}; }
};

Material plain(const Eigen::Vector3d& colour, double gloss = 0);
Material glass();
/// A lamp behind coloured glass, lit at night.
Material lamp(const Eigen::Vector3d& colour, double glow);
/// Tyre and rim of a wheel that turns about x.
Material wheel_material(const Eigen::Vector2d& axle, double radius, const Eigen::Vector3d& rim);

class ThingBuilder {
 public:
  void block(Extent x, Extent y, Extent z, const Material& material);
  /// The block and its mirror image at -x.
  void pair(Extent x, Extent y, Extent z, const Material& material);
  /// A block whose top is narrower by `inset` to each side, and starts and ends at top_y.
  struct Roof {
    double inset = 0;
    Extent y;
  };
  void tapered(Extent x, Extent y, Extent z, const Roof& roof, const Material& material);
  void sphere(const Eigen::Vector3d& centre, double radius, const Material& material);
  /// A disc that turns about x, from side to side of the range, with its lowest point on the ground.
  void wheel(Extent x, double y, double radius, const Eigen::Vector3d& rim);
  void wheel_pair(Extent x, double y, double radius, const Eigen::Vector3d& rim);
  /// An upright pillar about its own axis through (x, y).
  void pillar(const Eigen::Vector2d& foot, Extent z, Extent radius, const Material& material);
  void add(std::unique_ptr<Solid> solid, const Material& material) { thing_.add(std::move(solid), material); }

  std::shared_ptr<const Thing> finish();

 private:
  Thing thing_;
};

}  // namespace cloam
