// The rays of a LiDAR that sent nothing back. No log has them: they are where the pattern of the others has gaps.
#pragma once
#include "models/scene/lidar_points.h"
#include "models/street/street.h"

namespace cloam {

/// Of the LiDAR that turns. Its beams are found by their elevations, their steps by the usual angle between returns
/// that follow each other; missing rays stand evenly in gaps of two steps and more, all around. Beams that no clear
/// elevation tells, or that sent fewer than eight returns, have none; nor have directions in which the recording car
/// stands, where the log says that (Recording::car). Each has its own origin and time if returns do.
WorldRays missing_rays(const Recording& recording, const Sweep& sweep, const LidarPoints& points, int scene);

}  // namespace cloam
