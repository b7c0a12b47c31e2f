// See chamfer.h. A k-d tree (Bentley 1975) whose nodes are ranges of one list: the middle of a range parts it along its
// longest side.
#include "models/metrics/chamfer.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "runtime/error.h"

namespace cloam {
namespace {

using Points = std::vector<Eigen::Vector3d>;

class NearestPoint {
 public:
  explicit NearestPoint(Points points) : points_(std::move(points)), axes_(points_.size()) { part(0, points_.size()); }

  double squared_distance(const Eigen::Vector3d& from) const {
    double best = std::numeric_limits<double>::infinity();
    search(from, 0, points_.size(), best);
    return best;
  }

 private:
  void part(size_t begin, size_t end) {
    if (end - begin < 2) return;
    Eigen::Vector3d low = points_[begin], high = low;
    for (size_t i = begin; i < end; i++) low = low.cwiseMin(points_[i]), high = high.cwiseMax(points_[i]);
    Eigen::Index axis = 0;
    (high - low).maxCoeff(&axis);
    const size_t middle = begin + (end - begin) / 2;
    const auto at = [&](size_t i) { return points_.begin() + static_cast<std::ptrdiff_t>(i); };
    std::nth_element(at(begin), at(middle), at(end),
                     [axis](const auto& a, const auto& b) { return a[axis] < b[axis]; });
    axes_[middle] = axis;
    part(begin, middle);
    part(middle + 1, end);
  }

  void search(const Eigen::Vector3d& from, size_t begin, size_t end, double& best) const {
    if (begin == end) return;
    const size_t middle = begin + (end - begin) / 2;
    best = std::min(best, (points_[middle] - from).squaredNorm());
    const double beyond = from[axes_[middle]] - points_[middle][axes_[middle]];  // above 0: on the upper side
    beyond > 0 ? search(from, middle + 1, end, best) : search(from, begin, middle, best);
    if (beyond * beyond >= best) return;
    beyond > 0 ? search(from, begin, middle, best) : search(from, middle + 1, end, best);
  }

  Points points_;
  std::vector<Eigen::Index> axes_;
};

Points points_of(std::span<const float> values) {
  if (values.size() % 3 != 0) bad_data("chamfer needs x y z of each point, got ", values.size(), " values");
  Points points;
  for (size_t i = 0; i < values.size(); i += 3) {
    points.push_back(Eigen::Vector3f(values[i], values[i + 1], values[i + 2]).cast<double>());
    if (!points.back().allFinite()) bad_data("chamfer: point ", i / 3, " is not finite");
  }
  return points;
}

double sum_to_nearest(const Points& from, const Points& to) {
  const NearestPoint nearest(to);
  double sum = 0;
  for (const Eigen::Vector3d& point : from) sum += nearest.squared_distance(point);
  return sum;
}

}  // namespace

ChamferSums chamfer(std::span<const float> a, std::span<const float> b) {
  const Points of_a = points_of(a), of_b = points_of(b);
  return {sum_to_nearest(of_a, of_b), sum_to_nearest(of_b, of_a), of_a.size(), of_b.size()};
}

}  // namespace cloam
