// See actor_space.h.
#include "models/scene/actor_space.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace cloam {
namespace {

constexpr double kSphereMargin = 1e-6;  // metres

/// Whether the line from a to b goes through the box of that half size around the origin, with both ends outside: the
/// shares of the way at which it is between each pair of sides have something in common.
bool goes_through(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& half) {
  double enters = 0, leaves = 1;
  for (int k = 0; k < 3; ++k) {
    const double way = b[k] - a[k];
    if (way == 0) {
      if (std::abs(a[k]) >= half[k]) return false;
      continue;
    }
    const double one = (-half[k] - a[k]) / way, other = (half[k] - a[k]) / way;
    enters = std::max(enters, std::min(one, other));
    leaves = std::min(leaves, std::max(one, other));
  }
  return 0 < enters && enters < leaves && leaves < 1;
}

}  // namespace

ActorSpace::ActorSpace(const Scene& scene, double time, const std::vector<bool>& without, const Eigen::Vector3d& room) {
  Eigen::AlignedBox3d all;
  for (std::size_t a = 0; a < scene.actors.size(); ++a) {
    if (a < without.size() && without[a]) continue;
    const auto pose = world_from_box_at(scene.actors[a], time);
    if (!pose) continue;
    const Eigen::Vector3d half = (scene.actors[a].size / 2 + room).cwiseMax(0);
    boxes_.push_back({pose->inverse(), half, pose->topRightCorner<3, 1>()});
    reach_ = std::max(reach_, half.norm() + kSphereMargin);
    all.extend(boxes_.back().centre);
  }
  if (!boxes_.empty()) all.sizes().maxCoeff(&axis_);
  std::sort(boxes_.begin(), boxes_.end(),
            [&](const Box& a, const Box& b) { return a.centre[axis_] < b.centre[axis_]; });
}

bool ActorSpace::holds(const Eigen::Vector3d& world) const {
  const double place = world[axis_];
  const auto first = std::lower_bound(boxes_.begin(), boxes_.end(), place - reach_,
                                      [&](const Box& box, double at) { return box.centre[axis_] < at; });
  for (auto box = first; box != boxes_.end() && box->centre[axis_] <= place + reach_; ++box) {
    if ((world - box->centre).squaredNorm() > reach_ * reach_) continue;
    const Eigen::Vector3d p = (box->box_from_world * world.homogeneous()).head<3>();
    if ((p.cwiseAbs().array() < box->half.array()).all()) return true;
  }
  return false;
}

bool ActorSpace::stands_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) const {
  const Eigen::Vector3d way = b - a;
  const double length = std::max(way.norm(), kSphereMargin);
  return std::any_of(boxes_.begin(), boxes_.end(), [&](const Box& box) {
    const Eigen::Vector3d to_centre = box.centre - a;
    const Eigen::Vector3d nearest = way * std::clamp(way.dot(to_centre) / (length * length), 0.0, 1.0);
    if ((nearest - to_centre).squaredNorm() > box.half.squaredNorm()) return false;
    return goes_through((box.box_from_world * a.homogeneous()).head<3>(),
                        (box.box_from_world * b.homogeneous()).head<3>(), box.half);
  });
}

}  // namespace cloam
