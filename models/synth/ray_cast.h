// Exact rays against a handful of solids, Lambert shading with one sun and hard shadows: the truth behind the synthetic
// scenes. World frame right-handed, z up, metres. Host code in double; nothing here is trained or differentiated.
#pragma once
#include <Eigen/Geometry>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "models/scene/pose.h"

namespace cloam {

struct Ray {
  Eigen::Vector3d origin;
  Eigen::Vector3d direction;  // unit length
};

struct RayHit {
  double distance = 0;
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // unit length, out of the solid
};

/// A solid about its own origin.
class Solid {
 public:
  virtual ~Solid() = default;
  /// The nearest hit further than `nearest` along the ray.
  virtual std::optional<RayHit> hit(const Ray& ray, double nearest) const = 0;
  virtual Eigen::AlignedBox3d bounds() const = 0;
};

std::unique_ptr<Solid> make_sphere(double radius);
std::unique_ptr<Solid> make_box(const Eigen::Vector3d& half_size);

/// A box whose bottom and top are rectangles of different sizes and places. Rays that start inside it miss it.
struct TaperedShape {
  Eigen::AlignedBox2d bottom, top;  // in x and y
  double low = 0, high = 1;         // z
};
std::unique_ptr<Solid> make_tapered(const TaperedShape& shape);

/// Ring in the xz plane around the y axis; the part nearer than `cut` to the line x = cut_axis_x parallel to z is
/// absent.
struct RingShape {
  double radius = 1, thickness = 0.1;  // of the ring's centre line, and of its tube
  double cut_axis_x = 0, cut = 0;
};
std::unique_ptr<Solid> make_ring(const RingShape& shape);

/// Turns a profile of (radius, z) about the z axis. The profile runs from the axis to the axis with the solid on its
/// left; edges of more than about 45 degrees stay sharp, the rest is shaded smoothly.
std::unique_ptr<Solid> make_revolution(const std::vector<Eigen::Vector2d>& profile);

/// The solid turned and then moved to `centre`.
std::unique_ptr<Solid> make_placed(std::unique_ptr<Solid> solid, const Eigen::Vector3d& centre,
                                   const Eigen::Matrix3d& turn);

/// A smooth curve through the points (Catmull-Rom), `steps` pieces between neighbours.
std::vector<Eigen::Vector2d> smooth_profile(const std::vector<Eigen::Vector2d>& points, int steps);

/// Linear reflectance (RGB in [0,1]) at a point of the solid's own frame.
using Albedo = std::function<Eigen::Vector3d(const Eigen::Vector3d& point)>;

/// A solid turned by world_from_solid and then moved to `centre`.
struct SceneObject {
  std::shared_ptr<const Solid> solid;
  Albedo albedo;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  Eigen::Matrix3d world_from_solid = Eigen::Matrix3d::Identity();
};

/// Linear RGB of the nearest surface, or nothing where the ray leaves the scene.
std::optional<Eigen::Vector3d> shade(const std::vector<SceneObject>& objects, const Ray& ray);

}  // namespace cloam
