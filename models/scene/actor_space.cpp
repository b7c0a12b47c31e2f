// See actor_space.h.
#include "models/scene/actor_space.h"

#include <Eigen/Geometry>
#include <algorithm>

namespace cloam {
namespace {

constexpr double kSphereMargin = 1e-6;  // metres

}  // namespace

ActorSpace::ActorSpace(const Scene& scene, double time, const std::vector<bool>& without) {
  Eigen::AlignedBox3d all;
  for (std::size_t a = 0; a < scene.actors.size(); ++a) {
    if (a < without.size() && without[a]) continue;
    const auto pose = world_from_box_at(scene.actors[a], time);
    if (!pose) continue;
    const Eigen::Vector3d half = scene.actors[a].size / 2 + Eigen::Vector3d(0.2, 0.2, 0.1);
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

}  // namespace cloam
