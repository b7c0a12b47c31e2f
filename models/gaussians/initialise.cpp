// See initialise.h.
#include "models/gaussians/initialise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>

#include "runtime/error.h"

namespace cloam {
namespace {

constexpr double kMinSquaredDistance = 1e-7;
constexpr double kFirstOpacity = 0.1;

struct Point {
  std::array<float, 3> place;
  std::size_t index;  // in the cloud
};

double squared_distance(const Point& a, const Point& b) {
  double sum = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double difference = double(a.place[axis]) - double(b.place[axis]);
    sum += difference * difference;
  }
  return sum;
}

// The squared distances to the nearest three so far, in order.
struct Nearest {
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  std::array<double, 3> squares{kNone, kNone, kNone};

  void take(double square) {
    if (square >= squares[2]) return;
    squares[2] = square;
    if (squares[2] < squares[1]) std::swap(squares[1], squares[2]);
    if (squares[1] < squares[0]) std::swap(squares[0], squares[1]);
  }
  double mean() const {
    double sum = 0, count = 0;
    for (const double square : squares) {
      if (square < kNone) sum += square, ++count;
    }
    return count > 0 ? sum / count : 0;
  }
};

/// A k-d tree without nodes (Bentley 1975): the points stand in such an order that the middle one of a range parts it
/// along an axis, those before it below, those after it above.
class PointTree {
 public:
  explicit PointTree(std::vector<Point> points) : points_(std::move(points)), axes_(points_.size()) {
    build(0, points_.size());
  }

  std::span<const Point> points() const { return points_; }

  Nearest nearest_to(const Point& point) const {
    Nearest nearest;
    search(point, 0, points_.size(), nearest);
    return nearest;
  }

 private:
  static constexpr std::size_t kLeaf = 8;  // so few are looked through one by one

  void build(std::size_t begin, std::size_t end) {
    if (end - begin <= kLeaf) return;
    const std::size_t middle = (begin + end) / 2, axis = widest_axis(begin, end);
    const auto at = [&](std::size_t i) { return points_.begin() + static_cast<std::ptrdiff_t>(i); };
    std::nth_element(at(begin), at(middle), at(end),
                     [axis](const Point& a, const Point& b) { return a.place[axis] < b.place[axis]; });
    axes_[middle] = static_cast<std::uint8_t>(axis);
    build(begin, middle);
    build(middle + 1, end);
  }

  std::size_t widest_axis(std::size_t begin, std::size_t end) const {
    std::array<float, 3> least = points_[begin].place, most = least;
    for (std::size_t i = begin + 1; i < end; ++i) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        least[axis] = std::min(least[axis], points_[i].place[axis]);
        most[axis] = std::max(most[axis], points_[i].place[axis]);
      }
    }
    std::size_t widest = 0;
    for (std::size_t axis = 1; axis < 3; ++axis) {
      if (most[axis] - least[axis] > most[widest] - least[widest]) widest = axis;
    }
    return widest;
  }

  void search(const Point& point, std::size_t begin, std::size_t end, Nearest& nearest) const {
    if (end - begin <= kLeaf) {
      for (std::size_t i = begin; i < end; ++i) look_at(point, i, nearest);
      return;
    }
    const std::size_t middle = (begin + end) / 2, axis = axes_[middle];
    const double beyond = double(point.place[axis]) - double(points_[middle].place[axis]);
    look_at(point, middle, nearest);
    search(point, beyond < 0 ? begin : middle + 1, beyond < 0 ? middle : end, nearest);
    if (beyond * beyond < nearest.squares[2]) {
      search(point, beyond < 0 ? middle + 1 : begin, beyond < 0 ? end : middle, nearest);
    }
  }

  void look_at(const Point& point, std::size_t i, Nearest& nearest) const {
    if (points_[i].index != point.index) nearest.take(squared_distance(point, points_[i]));
  }

  std::vector<Point> points_;
  std::vector<std::uint8_t> axes_;  // that the point of this place parts its range along
};

PointTree tree_of(const PointCloud& cloud) {
  std::vector<Point> points(cloud.count());
  for (std::size_t i = 0; i < points.size(); ++i) {
    points[i].index = i;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      points[i].place[axis] = cloud.positions[3 * i + axis];
      if (!std::isfinite(points[i].place[axis]))
        bad_data("point ", i, " of the cloud has a position that is not finite");
    }
  }
  return PointTree(std::move(points));
}

}  // namespace

Gaussians gaussians_from_points(const PointCloud& cloud) {
  const std::size_t count = cloud.count();
  Gaussians gaussians;
  gaussians.means = cloud.positions;
  gaussians.scales.resize(3 * count);
  gaussians.rotations.resize(4 * count);
  gaussians.opacities.assign(count, static_cast<float>(std::log(kFirstOpacity / (1 - kFirstOpacity))));
  gaussians.sh_first.resize(3 * count);
  gaussians.sh_rest.resize(3 * kSphericalRest * count);
  const PointTree tree = tree_of(cloud);
  for (const Point& point : tree.points()) {  // neighbours one after the other
    const double square = std::max(kMinSquaredDistance, tree.nearest_to(point).mean());
    const float scale = static_cast<float>(0.5 * std::log(square));
    std::fill_n(&gaussians.scales[3 * point.index], 3, scale);
  }
  for (std::size_t g = 0; g < count; ++g) gaussians.rotations[4 * g] = 1;
  for (std::size_t i = 0; i < 3 * count; ++i) {
    gaussians.sh_first[i] = static_cast<float>((cloud.colours[i] / 255.0 - 0.5) / kSphericalFirst);
  }
  return gaussians;
}

}  // namespace cloam
