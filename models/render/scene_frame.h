// Normalised scene coordinates: where the subject lies, in [-1,1]^3.
#pragma once
#include "models/scene/scene.h"

namespace cloam {

/// normalised = (world - centre) * scale. contract: what lies outside [-1,1]^3 is folded into the shell up to [-2,2]^3.
struct SceneFrame {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  double scale = 1;
  bool contract = false;
};

/// Object scenes keep their box [-1.5,1.5]^3. Others: centre = the point nearest to all optical axes, scale = 1 over
/// the cameras' mean distance from it, contracted.
SceneFrame fit_scene(const Scene& scene);

}  // namespace cloam
