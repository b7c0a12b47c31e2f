// The LiDAR points of one sweep, read into memory.
#pragma once
#include "models/scene/lidar_points.h"
#include "models/scene/scene.h"

namespace cloam {

/// Fault::data for a file that is damaged or no sweep, naming it.
LidarPoints load_sweep(const Scene& scene, const Sweep& sweep);

}  // namespace cloam
