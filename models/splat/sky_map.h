// What is infinitely far: six square images around all directions (a cube map).
#pragma once
#include <Eigen/Core>

#include "models/scene/camera.h"
#include "runtime/ops.h"

namespace cloam {

/// The directions of a pinhole's pixels in camera axes, [H*W,3].
Tensor directions_of(const Camera& camera);
/// Where directions [P,3] of a camera that stands like this meet faces of S x S texels in the world's axes -> int32
/// [3,P], cube_taps (runtime/ops/cube_map.h).
Tensor sky_taps(const Tensor& directions, const Eigen::Matrix4d& world_from_camera, int64_t side);
/// Taps [3,P] that read the nearest texel of each place alone.
Tensor nearest_taps(const Tensor& taps);
/// Faces of cube_colours (runtime/ops/cube_map.h), in the world's axes, and directions [P,3] in those of a camera that
/// stands like this -> [3,P]. Differentiable in the faces.
Tensor sky_colours(const Tensor& faces, const Tensor& directions, const Eigen::Matrix4d& world_from_camera);

}  // namespace cloam
