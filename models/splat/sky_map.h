// What is infinitely far: six square images around all directions (a cube map).
#pragma once
#include <Eigen/Core>

#include "models/scene/camera.h"
#include "runtime/ops.h"

namespace cloam {

/// The directions of a pinhole's pixels in camera axes, [H*W,3].
Tensor directions_of(const Camera& camera);
/// Where they are on faces of S x S texels in the world's axes, of a camera that stands like this: cube_taps
/// (runtime/ops/cube_map.h).
Tensor sky_taps(const Tensor& directions, const Eigen::Matrix4d& world_from_camera, int64_t side);
/// The same of the nearest texels alone.
Tensor nearest_taps(const Tensor& taps);
/// Faces of cube_colours (runtime/ops/cube_map.h), in the world's axes, and directions [P,3] in those of a camera that
/// stands like this -> [3,P]. Differentiable in the faces.
Tensor sky_colours(const Tensor& faces, const Tensor& directions, const Eigen::Matrix4d& world_from_camera);

}  // namespace cloam
