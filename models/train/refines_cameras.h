// Capability: where its photos were taken and the lenses of its cameras change while it learns.
#pragma once
#include <Eigen/Core>
#include <map>
#include <string>
#include <vector>

#include "models/scene/camera.h"
#include "models/scene/scene.h"

namespace cloam {

class RefinesCameras {
 public:
  virtual ~RefinesCameras() = default;
  /// world_from_camera of the training photos of a scene (its place among the run's) as they were learned, in the order
  /// of frames_of(scene, Split::train); empty where the settings leave poses as they are.
  virtual std::vector<Eigen::Matrix4d> refined_poses(int scene) const = 0;
  /// Of its Scene::cameras, how the lenses that were learned differ from those given; empty where the settings leave
  /// them as they are.
  virtual std::vector<LensChange> lens_changes(int scene) const = 0;
};

/// The refined poses by Frame::name. trained: that scene, as the method was built of it.
std::map<std::string, Eigen::Matrix4d> poses_by_name(const RefinesCameras& method, const Scene& trained, int scene);

}  // namespace cloam
