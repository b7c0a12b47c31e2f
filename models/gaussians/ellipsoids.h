// Gaussians as solid ellipsoids, which shows how large they are and how they lie where a blended picture hides it.
#pragma once
#include "models/gaussians/gaussians.h"
#include "models/scene/view.h"

namespace cloam {

struct EllipsoidOptions {
  double deviations = 1;     // from the mean to the surface
  double least_opacity = 0;  // fainter gaussians are left out
  double near = 0;           // scene units: gaussians whose mean is nearer are left out
  double background = 0;     // grey where no ellipsoid is
};

/// What each ray of the view meets first, in the colour of degree 0 and shaded by the angle at which it meets it.
/// Depths are exact: distances along the ray to the surface. A gaussian that the camera is in is left out.
Picture ellipsoid_picture(const Gaussians& gaussians, const View& view, const EllipsoidOptions& options);

}  // namespace cloam
