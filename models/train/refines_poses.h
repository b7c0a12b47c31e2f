// Capability: the poses of its photos move while it learns.
#pragma once
#include <Eigen/Core>
#include <vector>

namespace cloam {

class RefinesPoses {
 public:
  virtual ~RefinesPoses() = default;
  /// world_from_camera of the training photos as they were learned, in the order of frames_of(scene, Split::train);
  /// empty where the settings leave poses as they are.
  virtual std::vector<Eigen::Matrix4d> refined_poses() const = 0;
};

}  // namespace cloam
