// Bilinear sampling (ops/sample.cpp): half-pixel centres, border padding, channels last. Places are in [0,1] along each
// axis. Any number of times differentiable in images and places; the composed forms are the reference. [A,...] with
// `owners` int32 [S] in [0,A) holds many, and says which each sample reads.
#pragma once
#include "runtime/ops.h"

namespace cloam {

/// images [H,W,C] or [A,H,W,C], places [S,2] (x, y) -> [S,C].
Tensor sample_images(const Tensor& images, const Tensor& places, const Tensor& owners = {});
Tensor sample_images_composed(const Tensor& images, const Tensor& places, const Tensor& owners = {});
/// Tri-planes, three images of a point: planes [3,H,W,C] or [3,A,H,W,C] (xy, xz, yz), points [S,3] -> [S,3C].
Tensor sample_planes(const Tensor& planes, const Tensor& points, const Tensor& owners = {});
Tensor sample_planes_composed(const Tensor& planes, const Tensor& points, const Tensor& owners = {});

}  // namespace cloam
