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

/// Points [N,3] of the world in the coordinates of a frame without ndc.
std::vector<float> normalised(const std::vector<float>& world, const SceneFrame& frame);

/// The parts of it. directions: [H*W,3] of length 1, in camera axes.
std::vector<float> unit_directions(const Camera& camera);
/// How wide a pixel is at distance 1, [H*W], of its unit directions: the root of the solid angle between it and its
/// neighbours.
std::vector<float> pixel_widths(const std::vector<float>& directions, int width, int height);
/// Appends 12 numbers: the rotation by rows, the position (normalised).
void append_pose(std::vector<float>& poses, const Eigen::Matrix4d& world_from_camera, const SceneFrame& frame);
/// directions [R,3] in camera axes, poses [R,12] (or [1,12]).
Rays world_rays(const Tensor& directions, const Tensor& poses, const SceneFrame& frame, const RayRange& range);

/// NeRF's normalised device coordinates (Mildenhall et al. 2020, appendix C; its -z is our z) of points whose first two
/// coordinates are `across` [R,2] and whose depth is z [R,1]: (widen_x x / z, widen_y y / z, 1 - 2 / z). The near
/// plane, z = 1, comes to -1 and what is infinitely far to 1.
Tensor ndc_points(const Tensor& across, const Tensor& z, const SceneFrame& frame);
/// Lines stay lines: rays of a frame with ndc, from the near plane (or their origin, where it lies behind) to infinity,
/// as rays through [-1,1]^3 of that space. Those that never come to the near plane have far < near.
Rays ndc_rays(const Rays& rays, const SceneFrame& frame);
/// Of `along` [R], lengths on the way of ndc_rays(rays, frame): the distances from the rays' origins, [R].
Tensor ndc_distances(const Rays& rays, const SceneFrame& frame, const Tensor& along);

}  // namespace cloam
