// See hidden_ground.h.
#include "models/splat/hidden_ground.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include "models/gaussians/values.h"
#include "models/io/in_parallel.h"

namespace cloam {
namespace {

using Eigen::Vector3d;

const Vector3d kTight(-0.2, -0.2, -0.1);           // metres: of boxes that hide what is behind them for certain
constexpr double kRaised = 0.2;                    // metres above the ground of what they must hide
constexpr double kFarInView = 60;                  // metres from a camera
constexpr double kGround = 0.3;                    // metres above or below where actors nearby stand
constexpr double kAround = 6;                      // metres
constexpr int kEnough = 12;                        // cells that heights and colours are taken from
constexpr double kWidth = 0.6, kThickness = 0.02;  // deviations: of a cell's side; metres
constexpr double kOpacity = 0.98, kLeastOpacity = 1e-4;

/// A square of the ground, by numbers of sides along x and y.
using Cell = Eigen::Array2i;

/// What points in a cell say: sums, and over how much.
struct Ground {
  float height = 0, points = 0;
  Eigen::Vector3f colour = Eigen::Vector3f::Zero();  // first coefficients
  float seen = 0;                                    // points that photos show

  /// Adds the other's means.
  void add_means(const Ground& other, float weight) {
    if (other.points > 0) {
      height += weight * other.height / other.points;
      points += weight;
    }
    if (other.seen > 0) {
      colour += weight * other.colour / other.seen;
      seen += weight;
    }
  }
};

/// Of points: what photos show of them.
enum PointKind : char { kElsewhere, kHiddenPoint, kSeenPoint };  // not on the ground; on it

/// Where actors stand: the middles of their boxes' bottoms, one for each metre.
std::vector<Vector3d> footings(const Scene& scene) {
  std::map<std::array<int, 3>, Vector3d> found;
  for (const Actor& actor : scene.actors)
    for (const ActorBox& box : actor.boxes) {
      const Vector3d foot = (box.world_from_box * Vector3d(0, 0, -actor.size.z() / 2).homogeneous()).head<3>();
      const Eigen::Array3i at = foot.array().floor().cast<int>();
      found.emplace(std::array<int, 3>{at.x(), at.y(), at.z()}, foot);
    }
  std::vector<Vector3d> out;
  for (const auto& [at, foot] : found) out.push_back(foot);
  return out;
}

bool lies_on_ground(const Vector3d& point, const std::vector<Vector3d>& feet) {
  const auto nearest = std::min_element(feet.begin(), feet.end(), [&](const Vector3d& a, const Vector3d& b) {
    return (a - point).head<2>().squaredNorm() < (b - point).head<2>().squaredNorm();
  });
  return std::abs(nearest->z() - point.z()) < kGround;
}

/// Photos with what hides the ground from them.
class Viewers {
 public:
  /// Both must outlive it. height: metres above the ground of what must be hidden.
  Viewers(const StreetPhotos& photos, double height) : photos_(photos), above_(0, 0, height) {}

  /// Whether what is known of the point may say something of one that a photo has in view; heights do not count.
  bool are_near(const Vector3d& point) const {
    return std::any_of(photos_.all().begin(), photos_.all().end(), [&](const StreetPhotos::One& one) {
      return (point - eye_of(one)).head<2>().norm() < kFarInView + kAround;
    });
  }
  /// Whether photos have the point in view, and each has an actor there or before it; none: no photo has it in view.
  std::optional<bool> hide(const Vector3d& point) const {
    std::optional<bool> hidden;
    const Vector3d raised = point + above_;
    for (const StreetPhotos::One& one : photos_.all()) {
      const Vector3d eye = eye_of(one);
      if ((point - eye).norm() > kFarInView || !pixel_that_shows(one.photo.photo, point)) continue;
      if (!one.actors.holds(raised) && !one.actors.stands_between(eye, raised)) return false;
      hidden = true;
    }
    return hidden;
  }

 private:
  static Vector3d eye_of(const StreetPhotos::One& one) {
    return one.photo.photo.world_from_camera.topRightCorner<3, 1>();
  }

  const StreetPhotos& photos_;
  Vector3d above_;
};

/// The ground as points of the background show it, by cells of a rectangle around all of them.
class GroundMap {
 public:
  /// kinds: of the first points of the background, PointKind.
  GroundMap(const Gaussians& background, const std::vector<char>& kinds, double side)
      : side_(side), room_(static_cast<int>(kAround / side)) {
    std::vector<std::size_t> on_ground;
    for (std::size_t i = 0; i < kinds.size(); ++i)
      if (kinds[i] != kElsewhere) on_ground.push_back(i);
    if (on_ground.empty()) return;
    enclose(background, on_ground);
    for (const std::size_t i : on_ground) {
      Ground& ground = cells_[number_of(cell_of(mean_of(background, i)) - first_)];
      ground.height += background.means[3 * i + 2];
      ++ground.points;
      if (kinds[i] != kSeenPoint) continue;
      ground.colour += Eigen::Map<const Eigen::Vector3f>(&background.sh_first[3 * i]);
      ++ground.seen;
    }
  }

  struct Found {
    Vector3d point;
    Eigen::Vector3f colour;
  };
  /// The cells that photos have in view but do not show, and of which something near tells how they are.
  std::vector<Found> hidden_from(const Viewers& viewers) const {
    std::vector<std::vector<Found>> rows(static_cast<std::size_t>(size_.y()));
    in_parallel(rows.size(), [&](std::size_t row) {
      for (int x = 0; x < size_.x(); ++x)
        if (const auto found = look({x, static_cast<int>(row)}, viewers)) rows[row].push_back(*found);
    });
    std::vector<Found> all;
    for (const std::vector<Found>& row : rows) all.insert(all.end(), row.begin(), row.end());
    return all;
  }

 private:
  void enclose(const Gaussians& background, const std::vector<std::size_t>& points) {
    Cell first = cell_of(mean_of(background, points.front())), last = first;
    for (const std::size_t i : points) {
      first = first.min(cell_of(mean_of(background, i)));
      last = last.max(cell_of(mean_of(background, i)));
    }
    first_ = first - room_;
    size_ = last - first + 1 + 2 * room_;
    cells_.resize(static_cast<std::size_t>(size_.x()) * static_cast<std::size_t>(size_.y()));
  }

  Cell cell_of(const Vector3d& point) const { return (point.head<2>() / side_).array().floor().cast<int>(); }
  /// at: from the first cell on.
  std::size_t number_of(const Cell& at) const {
    return static_cast<std::size_t>(at.y()) * static_cast<std::size_t>(size_.x()) + static_cast<std::size_t>(at.x());
  }

  std::optional<Found> look(const Cell& at, const Viewers& viewers) const {
    Vector3d point;
    point << side_ * ((first_ + at).cast<double>() + 0.5), 0;
    if (!viewers.are_near(point)) return std::nullopt;
    const Ground around = ground_around(at);
    if (around.points == 0 || around.seen == 0) return std::nullopt;
    point.z() = double{around.height / around.points};
    if (viewers.hide(point) != true) return std::nullopt;
    return Found{point, around.colour / around.seen};
  }

  /// Means of cells, ring by ring until there are enough, weighted by the inverse of the squared distance.
  Ground ground_around(const Cell& at) const {
    Ground out;
    int points = 0, seen = 0;
    for (int ring = 0; ring <= room_ && (points < kEnough || seen < kEnough); ++ring)
      for (int dy = -ring; dy <= ring; ++dy)
        for (int dx = -ring; dx <= ring; dx += std::abs(dy) == ring ? 1 : 2 * ring) {
          const Cell there = at + Cell(dx, dy);
          if ((there < 0).any() || (there >= size_).any()) continue;
          const Ground& one = cells_[number_of(there)];
          out.add_means(one, 1 / (0.25f + static_cast<float>(dx * dx + dy * dy)));
          points += one.points > 0;
          seen += one.seen > 0;
        }
    return out;
  }

  double side_;
  int room_;  // cells
  Cell first_ = {0, 0}, size_ = {0, 0};
  std::vector<Ground> cells_;
};

/// [start.seen] of PointKind.
std::vector<char> kinds_of(const StreetStart& start, const Viewers& viewers, const std::vector<Vector3d>& feet) {
  std::vector<char> kinds(start.seen, kElsewhere);
  in_parallel(kinds.size(), [&](std::size_t i) {
    const Vector3d point = mean_of(start.background, i);
    if (viewers.are_near(point) && lies_on_ground(point, feet))
      kinds[i] = viewers.hide(point) == false ? kSeenPoint : kHiddenPoint;
  });
  return kinds;
}

}  // namespace

Gaussians hidden_ground(const std::vector<TimedPhoto>& photos, const Scene& scene, const StreetStart& start,
                        double side) {
  const std::vector<Vector3d> feet = footings(scene);
  if (feet.empty()) return {};
  const StreetPhotos roomy(photos, scene), tight(photos, scene, kTight);
  const GroundMap map(start.background, kinds_of(start, Viewers(roomy, 0), feet), side);
  std::vector<float> means, first;
  for (const auto& [point, colour] : map.hidden_from(Viewers(tight, kRaised))) {
    for (int k = 0; k < 3; ++k) means.push_back(static_cast<float>(point[k]));
    first.insert(first.end(), colour.begin(), colour.end());
  }
  return flat_gaussians(std::move(means), std::move(first), side);
}

Gaussians flat_gaussians(std::vector<float> means, std::vector<float> first, double side) {
  Gaussians out;
  const auto wide = static_cast<float>(std::log(kWidth * side)), thin = static_cast<float>(std::log(kThickness));
  const std::size_t count = means.size() / 3;
  for (std::size_t i = 0; i < count; ++i) {
    out.scales.insert(out.scales.end(), {wide, wide, thin});
    out.rotations.insert(out.rotations.end(), {1, 0, 0, 0});
  }
  out.opacities.assign(count, logit(kOpacity, kLeastOpacity));
  out.sh_rest.resize(3 * kSphericalRest * count);
  out.means = std::move(means);
  out.sh_first = std::move(first);
  return out;
}

}  // namespace cloam
