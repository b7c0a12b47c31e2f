// What a training of gaussians begins with.
#pragma once
#include "models/gaussians/gaussians.h"
#include "models/scene/point_cloud.h"

namespace cloam {

/// A round gaussian a point, as 3D Gaussian Splatting begins (Kerbl et al. 2023, section 5.1): its deviation is the
/// square root of the mean squared distance to the three nearest other points (as many as there are, at least 1e-7),
/// its opacity 0.1, its colour the point's, the same from all sides. `up` and `metric` are for the caller to say.
/// Fault::data for a position that is not finite.
Gaussians gaussians_from_points(const PointCloud& cloud);

}  // namespace cloam
