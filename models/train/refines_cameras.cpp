// See refines_cameras.h.
#include "models/train/refines_cameras.h"

namespace cloam {

std::map<std::string, Eigen::Matrix4d> poses_by_name(const RefinesCameras& method, const Scene& trained, int scene) {
  const std::vector<Eigen::Matrix4d> poses = method.refined_poses(scene);
  std::map<std::string, Eigen::Matrix4d> out;
  if (poses.empty()) return out;
  std::size_t place = 0;
  for (const std::size_t frame : frames_of(trained, Split::train)) out[trained.frames[frame].name] = poses.at(place++);
  return out;
}

}  // namespace cloam
