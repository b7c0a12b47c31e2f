// What is infinitely far: six square images around all directions (a cube map).
#pragma once
#include <Eigen/Core>

#include "models/scene/camera.h"
#include "runtime/ops.h"

namespace cloam {

/// Faces [6,S,S,3] at +x, -x, +y, -y, +z, -z of the world, directions [P,3] of any length -> [P,3]. Bilinear within a
/// face; differentiable in the faces.
Tensor sky_colours(const Tensor& faces, const Tensor& directions);

/// The directions of a pinhole's pixels in camera axes, [H*W,3].
Tensor directions_of(const Camera& camera);
/// The same in the world.
Tensor turned_directions(const Tensor& directions, const Eigen::Matrix4d& world_from_camera);

}  // namespace cloam
