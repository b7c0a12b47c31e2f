// Sphere, box and turned profiles are solved in closed form; the ring is sphere traced (Hart 1996), since its quartic
// loses more digits than the march.
#include "models/synth/ray_cast.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace cloam {
namespace {

using Eigen::AlignedBox3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kShadowOffset = 1e-6;  // how far a shadow ray starts from its surface

Vector3d along(const Ray& ray, double distance) { return ray.origin + distance * ray.direction; }

AlignedBox3d cube(double half) { return {Vector3d::Constant(-half), Vector3d::Constant(half)}; }

/// Distances at which the ray enters and leaves a sphere about the origin.
std::optional<std::pair<double, double>> sphere_span(const Ray& ray, double radius) {
  const double middle = -ray.origin.dot(ray.direction);
  const double discriminant = middle * middle - ray.origin.squaredNorm() + radius * radius;
  if (discriminant < 0) return std::nullopt;
  const double half = std::sqrt(discriminant);
  return std::pair(middle - half, middle + half);
}

class Sphere : public Solid {
 public:
  explicit Sphere(double radius) : radius_(radius) {}

  std::optional<RayHit> hit(const Ray& ray, double nearest) const override {
    const auto span = sphere_span(ray, radius_);
    if (!span || span->second <= nearest) return std::nullopt;
    const double distance = span->first > nearest ? span->first : span->second;
    return RayHit{distance, along(ray, distance) / radius_};
  }

  AlignedBox3d bounds() const override { return cube(radius_); }

 private:
  double radius_;
};

class Box : public Solid {
 public:
  explicit Box(const Vector3d& half_size) : half_(half_size) {}

  // The ray is inside the box where it is inside all three slabs (Kay and Kajiya 1986).
  std::optional<RayHit> hit(const Ray& ray, double nearest) const override {
    double enter = nearest, leave = std::numeric_limits<double>::infinity();
    int axis = -1;
    for (int i = 0; i < 3; ++i) {
      double a = (-half_[i] - ray.origin[i]) / ray.direction[i], b = (half_[i] - ray.origin[i]) / ray.direction[i];
      if (a > b) std::swap(a, b);
      if (a > enter) enter = a, axis = i;
      leave = std::min(leave, b);
    }
    if (axis < 0 || enter > leave) return std::nullopt;
    Vector3d normal = Vector3d::Zero();
    normal[axis] = ray.direction[axis] > 0 ? -1 : 1;
    return RayHit{enter, normal};
  }

  AlignedBox3d bounds() const override { return {-half_, half_}; }

 private:
  Vector3d half_;
};

class Tapered : public Solid {
 public:
  explicit Tapered(const TaperedShape& shape) : bounds_(corner(shape, false), corner(shape, true)) {
    const double height = shape.high - shape.low;
    for (int axis = 0; axis < 2; ++axis) {
      for (const double sign : {-1.0, 1.0}) {
        const auto edge = [&](const Eigen::AlignedBox2d& box) { return sign > 0 ? box.max()[axis] : box.min()[axis]; };
        // sign (x - edge(z)) <= 0, where edge(z) runs straight from bottom to top.
        const double slope = (edge(shape.top) - edge(shape.bottom)) / height;
        Vector3d normal = Vector3d::Zero();
        normal[axis] = sign;
        normal.z() = -sign * slope;
        add(normal, sign * (edge(shape.bottom) - slope * shape.low));
      }
    }
    add(-Vector3d::UnitZ(), -shape.low);
    add(Vector3d::UnitZ(), shape.high);
  }

  // As the box, with planes that are not parallel.
  std::optional<RayHit> hit(const Ray& ray, double nearest) const override {
    double enter = nearest, leave = std::numeric_limits<double>::infinity();
    int face = -1;
    for (int i = 0; i < 6; ++i) {
      const double speed = normals_[std::size_t(i)].dot(ray.direction),
                   outside = normals_[std::size_t(i)].dot(ray.origin) - offsets_[std::size_t(i)];
      if (speed == 0 && outside > 0) return std::nullopt;
      const double distance = -outside / speed;
      if (speed < 0 && distance > enter) enter = distance, face = i;
      if (speed > 0) leave = std::min(leave, distance);
      if (enter > leave) return std::nullopt;
    }
    if (face < 0) return std::nullopt;
    return RayHit{enter, normals_[std::size_t(face)]};
  }

  AlignedBox3d bounds() const override { return bounds_; }

 private:
  static Vector3d corner(const TaperedShape& shape, bool far) {
    const Eigen::AlignedBox2d all = shape.bottom.merged(shape.top);
    const Vector2d place = far ? all.max() : all.min();
    return {place.x(), place.y(), far ? shape.high : shape.low};
  }

  void add(const Vector3d& normal, double offset) {
    normals_[count_] = normal.normalized();
    offsets_[count_++] = offset / normal.norm();
  }

  AlignedBox3d bounds_;
  std::array<Vector3d, 6> normals_;  // out of the solid
  std::array<double, 6> offsets_{};
  std::size_t count_ = 0;
};

class Ring : public Solid {
 public:
  explicit Ring(const RingShape& shape) : shape_(shape) {}

  std::optional<RayHit> hit(const Ray& ray, double nearest) const override {
    const auto span = sphere_span(ray, shape_.radius + shape_.thickness);
    if (!span || span->second <= nearest) return std::nullopt;
    double distance = std::max(span->first, nearest);
    for (int step = 0; step < 400 && distance < span->second; ++step) {
      const double clearance = outside(along(ray, distance));
      if (clearance < 1e-7) return RayHit{distance, normal(along(ray, distance))};
      distance += clearance;
    }
    return std::nullopt;
  }

  AlignedBox3d bounds() const override {
    const double reach = shape_.radius + shape_.thickness;
    return {Vector3d(-reach, -shape_.thickness, -reach), Vector3d(reach, shape_.thickness, reach)};
  }

 private:
  /// A lower bound of the distance to the ring, exact near its surface.
  double outside(const Vector3d& p) const {
    const double tube = std::hypot(std::hypot(p.x(), p.z()) - shape_.radius, p.y()) - shape_.thickness;
    return std::max(tube, shape_.cut - std::hypot(p.x() - shape_.cut_axis_x, p.y()));
  }

  Vector3d normal(const Vector3d& p) const {
    constexpr double kStep = 1e-6;
    Vector3d slope;
    for (int i = 0; i < 3; ++i)
      slope[i] = outside(p + kStep * Vector3d::Unit(i)) - outside(p - kStep * Vector3d::Unit(i));
    return slope.normalized();
  }

  RingShape shape_;
};

/// One straight piece of a profile turned about z: a frustum, or a flat annulus where it is level.
struct Frustum {
  Vector2d from = Vector2d::Zero(), to = Vector2d::Zero();                // (radius, z)
  Vector2d normal_from = Vector2d::Zero(), normal_to = Vector2d::Zero();  // out of the solid

  double fraction(double radius, double z) const {
    const Vector2d edge = to - from;
    return (Vector2d(radius, z) - from).dot(edge) / edge.squaredNorm();
  }

  /// Distances at which the ray meets the endless cone or plane of this piece.
  std::array<double, 2> meet(const Ray& ray) const {
    constexpr double kNever = -1;
    const Vector3d &o = ray.origin, &d = ray.direction;
    if (std::abs(to.y() - from.y()) < 1e-9) return {(from.y() - o.z()) / d.z(), kNever};
    // x^2 + y^2 = r(z)^2 with r(z) = from.r + slope (z - from.z)
    const double slope = (to.x() - from.x()) / (to.y() - from.y());
    const double radius = from.x() + slope * (o.z() - from.y());
    const double a = d.x() * d.x() + d.y() * d.y() - slope * slope * d.z() * d.z();
    const double b = o.x() * d.x() + o.y() * d.y() - slope * radius * d.z();
    const double c = o.x() * o.x() + o.y() * o.y() - radius * radius;
    const double discriminant = b * b - a * c;
    if (discriminant < 0) return {kNever, kNever};
    // Both roots without cancellation, and the only one when a vanishes.
    const double q = -(b + std::copysign(std::sqrt(discriminant), b));
    return {q / a, c / q};
  }
};

class Revolution : public Solid {
 public:
  explicit Revolution(const std::vector<Vector2d>& profile) {
    for (size_t i = 0; i + 1 < profile.size(); ++i) pieces_.push_back({.from = profile[i], .to = profile[i + 1]});
    for (const Vector2d& point : profile) {
      radius_ = std::max(radius_, point.x() + kSlack);
      low_ = std::min(low_, point.y() - kSlack);
      high_ = std::max(high_, point.y() + kSlack);
    }
    for (size_t i = 0; i < pieces_.size(); ++i) {
      pieces_[i].normal_from = shared_normal(i, i == 0 ? i : i - 1);
      pieces_[i].normal_to = shared_normal(i, std::min(i + 1, pieces_.size() - 1));
    }
  }

  std::optional<RayHit> hit(const Ray& ray, double nearest) const override {
    const auto [enter, leave] = bounding_span(ray);
    if (enter > leave || leave <= nearest) return std::nullopt;
    const double z_in = along(ray, enter).z(), z_out = along(ray, leave).z();
    const auto [low, high] = std::minmax(z_in, z_out);
    std::optional<RayHit> best;
    for (const Frustum& piece : pieces_) {
      if (std::max(piece.from.y(), piece.to.y()) < low || std::min(piece.from.y(), piece.to.y()) > high) continue;
      for (const double distance : piece.meet(ray)) {
        if (distance > nearest && !(best && distance >= best->distance)) consider(ray, piece, distance, best);
      }
    }
    return best;
  }

  AlignedBox3d bounds() const override {
    return {Vector3d(-radius_, -radius_, low_), Vector3d(radius_, radius_, high_)};
  }

 private:
  static constexpr double kSlack = 1e-6;

  /// Distances at which the ray enters and leaves the cylinder around the solid; entry after exit when it misses.
  std::pair<double, double> bounding_span(const Ray& ray) const {
    const Vector2d o = ray.origin.head<2>(), d = ray.direction.head<2>();
    double below = (low_ - ray.origin.z()) / ray.direction.z(), above = (high_ - ray.origin.z()) / ray.direction.z();
    if (below > above) std::swap(below, above);
    const double a = d.squaredNorm(), b = o.dot(d), c = o.squaredNorm() - radius_ * radius_;
    if (a < 1e-18) return c > 0 ? std::pair(1.0, 0.0) : std::pair(below, above);
    const double discriminant = b * b - a * c;
    if (discriminant < 0) return {1.0, 0.0};
    const double half = std::sqrt(discriminant);
    return {std::max(below, (-b - half) / a), std::min(above, (-b + half) / a)};
  }

  static void consider(const Ray& ray, const Frustum& piece, double distance, std::optional<RayHit>& best) {
    const Vector3d p = along(ray, distance);
    const double radius = std::hypot(p.x(), p.y());
    const double fraction = piece.fraction(radius, p.z());
    const Vector2d on_piece = piece.from + fraction * (piece.to - piece.from);
    // The cone's other half meets the ray too, where the radius would be negative.
    const bool same_half = (on_piece - Vector2d(radius, p.z())).norm() < 1e-6;
    if (!(fraction >= -1e-9 && fraction <= 1 + 1e-9) || !same_half) return;
    const Vector2d normal = (1 - fraction) * piece.normal_from + fraction * piece.normal_to;
    const Vector2d outward = radius > 0 ? Vector2d(p.x() / radius, p.y() / radius) : Vector2d(0, 0);
    best = RayHit{distance, Vector3d(normal.x() * outward.x(), normal.x() * outward.y(), normal.y()).normalized()};
  }

  Vector2d flat_normal(size_t i) const {
    const Vector2d edge = (pieces_[i].to - pieces_[i].from).normalized();
    return {edge.y(), -edge.x()};
  }

  Vector2d shared_normal(size_t own, size_t other) const {
    const Vector2d a = flat_normal(own), b = flat_normal(other);
    return a.dot(b) < 0.7 ? a : (a + b).normalized();
  }

  std::vector<Frustum> pieces_;
  double radius_ = 0;
  double low_ = std::numeric_limits<double>::infinity(), high_ = -low_;
};

class Placed : public Solid {
 public:
  Placed(std::unique_ptr<Solid> solid, const Vector3d& centre, const Eigen::Matrix3d& turn)
      : solid_(std::move(solid)), centre_(centre), turn_(turn) {}

  std::optional<RayHit> hit(const Ray& ray, double nearest) const override {
    auto found = solid_->hit({turn_.transpose() * (ray.origin - centre_), turn_.transpose() * ray.direction}, nearest);
    if (found) found->normal = turn_ * found->normal;
    return found;
  }

  AlignedBox3d bounds() const override {
    return solid_->bounds().transformed(Eigen::Affine3d(Eigen::Translation3d(centre_) * turn_));
  }

 private:
  std::unique_ptr<Solid> solid_;
  Vector3d centre_;
  Eigen::Matrix3d turn_;
};

Ray to_object(const SceneObject& object, const Ray& ray) {
  const Eigen::Matrix3d solid_from_world = object.world_from_solid.transpose();
  return {solid_from_world * (ray.origin - object.centre), solid_from_world * ray.direction};
}

bool in_shadow(const std::vector<SceneObject>& objects, const Ray& to_sun) {
  return std::any_of(objects.begin(), objects.end(), [&](const SceneObject& object) {
    return object.solid->hit(to_object(object, to_sun), 0).has_value();
  });
}

Vector3d light_at(const std::vector<SceneObject>& objects, const Vector3d& point, const Vector3d& normal) {
  static const Vector3d to_sun = Vector3d(0.55, -0.45, 0.95).normalized();
  static const Vector3d to_fill = Vector3d(-0.8, 0.5, 0.3).normalized();
  // A blue sky above and a warm bounce from below fill the shadows.
  const Vector3d sky(0.40, 0.44, 0.52), bounce(0.26, 0.20, 0.16);
  const double up = 0.5 + 0.5 * normal.z();
  Vector3d light = up * sky + (1 - up) * bounce;
  light += std::max(0.0, normal.dot(to_fill)) * Vector3d(0.10, 0.10, 0.12);
  const double sun = normal.dot(to_sun);
  if (sun > 0 && !in_shadow(objects, {point + kShadowOffset * normal, to_sun}))
    light += sun * Vector3d(1.0, 0.93, 0.80);
  return light;
}

}  // namespace

std::unique_ptr<Solid> make_sphere(double radius) { return std::make_unique<Sphere>(radius); }
std::unique_ptr<Solid> make_box(const Vector3d& half_size) { return std::make_unique<Box>(half_size); }
std::unique_ptr<Solid> make_tapered(const TaperedShape& shape) { return std::make_unique<Tapered>(shape); }
std::unique_ptr<Solid> make_placed(std::unique_ptr<Solid> solid, const Vector3d& centre, const Eigen::Matrix3d& turn) {
  return std::make_unique<Placed>(std::move(solid), centre, turn);
}
std::unique_ptr<Solid> make_ring(const RingShape& shape) { return std::make_unique<Ring>(shape); }
std::unique_ptr<Solid> make_revolution(const std::vector<Vector2d>& profile) {
  return std::make_unique<Revolution>(profile);
}

std::vector<Vector2d> smooth_profile(const std::vector<Vector2d>& points, int steps) {
  std::vector<Vector2d> curve;
  for (size_t i = 0; i + 1 < points.size(); ++i) {
    const Vector2d &a = points[i == 0 ? 0 : i - 1], &b = points[i], &c = points[i + 1];
    const Vector2d& d = points[std::min(i + 2, points.size() - 1)];
    for (int step = 0; step < steps; ++step) {
      const double t = double(step) / steps;
      const Vector2d slope = 0.5 * (c - a), slope_end = 0.5 * (d - b);
      const Vector2d cubic = 2 * (b - c) + slope + slope_end, square = 3 * (c - b) - 2 * slope - slope_end;
      curve.push_back(b + t * (slope + t * (square + t * cubic)));
    }
  }
  curve.push_back(points.back());
  return curve;
}

std::optional<Vector3d> shade(const std::vector<SceneObject>& objects, const Ray& ray) {
  const SceneObject* nearest = nullptr;
  RayHit best;
  for (const SceneObject& object : objects) {
    const auto hit = object.solid->hit(to_object(object, ray), 0);
    if (hit && (!nearest || hit->distance < best.distance)) best = *hit, nearest = &object;
  }
  if (!nearest) return std::nullopt;
  const Vector3d point = along(ray, best.distance);
  const Vector3d albedo = nearest->albedo(nearest->world_from_solid.transpose() * (point - nearest->centre));
  return albedo.cwiseProduct(light_at(objects, point, nearest->world_from_solid * best.normal));
}

}  // namespace cloam
