// Capability: where its photos were taken and the focal lengths of its cameras change while it learns.
#pragma once
#include <Eigen/Core>
#include <vector>

namespace cloam {

class RefinesCameras {
 public:
  virtual ~RefinesCameras() = default;
  /// world_from_camera of the training photos of a scene (its place among the run's) as they were learned, in the order
  /// of frames_of(scene, Split::train); empty where the settings leave poses as they are.
  virtual std::vector<Eigen::Matrix4d> refined_poses(int scene) const = 0;
  /// Of its Scene::cameras, the focal lengths that were learned over those given (with_focal of models/scene/camera.h);
  /// empty where the settings leave them as they are.
  virtual std::vector<double> focal_factors(int scene) const = 0;
};

}  // namespace cloam
