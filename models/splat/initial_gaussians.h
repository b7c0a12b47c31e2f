// Where a training of gaussians begins.
#pragma once
#include <string>

#include "models/scene/scene.h"
#include "models/splat/gaussians.h"

namespace cloam {

struct InitialOptions {
  std::string kind = "auto";  // auto | points | lidar | random | the path of a file, in the capture's world
  int random = 20000;         // how many points are drawn, or kept of LiDAR's
  uint64_t seed = 0;
};

/// points: those that came with the capture; lidar: of the sweeps that train, grey; random: in the region that the
/// cameras see in common; auto: the first of these that there is; a file's as they are. Fault::usage for an unknown
/// kind, Fault::data for points or sweeps that the capture does not have.
Gaussians initial_gaussians(const Scene& scene, const InitialOptions& options);

/// 3DGS's extent: 1.1 times the largest distance of a camera from their middle; 1 for cameras in one place.
double camera_radius(const Scene& scene);

}  // namespace cloam
