// See actor_space.h.
#include "models/scene/actor_space.h"

#include <Eigen/Geometry>
#include <algorithm>

namespace cloam {

ActorSpace::ActorSpace(const Scene& scene, double time, const std::vector<bool>& without) {
  for (std::size_t a = 0; a < scene.actors.size(); ++a) {
    if (a < without.size() && without[a]) continue;
    if (const auto pose = world_from_box_at(scene.actors[a], time))
      boxes_.push_back({pose->inverse(), scene.actors[a].size / 2 + Eigen::Vector3d(0.2, 0.2, 0.1)});
  }
}

bool ActorSpace::holds(const Eigen::Vector3d& world) const {
  return std::any_of(boxes_.begin(), boxes_.end(), [&](const Box& box) {
    const Eigen::Vector3d p = (box.box_from_world * world.homogeneous()).head<3>();
    return (p.cwiseAbs().array() < box.half.array()).all();
  });
}

}  // namespace cloam
