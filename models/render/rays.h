// Rays of cameras in normalised scene coordinates.
#pragma once
#include "models/render/scene_frame.h"
#include "models/scene/view.h"
#include "runtime/ops.h"
#include "runtime/ops/volume.h"

namespace cloam {

/// How far rays reach: through the box [-1,1]^3, or from `near` to `far` in a contracted scene.
struct RayRange {
  float near = 0.05f, far = 64.f;
};

/// Every pixel of a view, row-major [H*W]. Lengths along rays are in normalised units.
Rays view_rays(const View& view, const SceneFrame& frame, const RayRange& range);

/// The parts of it. directions: [H*W,3] of length 1, in camera axes.
std::vector<float> unit_directions(const Camera& camera);
/// Appends 12 numbers: the rotation by rows, the position (normalised).
void append_pose(std::vector<float>& poses, const Eigen::Matrix4d& world_from_camera, const SceneFrame& frame);
/// directions [R,3] in camera axes, poses [R,12] (or [1,12]).
Rays world_rays(const Tensor& directions, const Tensor& poses, const SceneFrame& frame, const RayRange& range);

}  // namespace cloam
