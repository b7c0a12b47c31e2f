// What is infinitely far: six square images around all directions (ops/cube_map.cpp).
#pragma once
#include "runtime/ops.h"

namespace cloam {

constexpr int32_t kTapUnit = 1 << 30;  // taps: of the way to the next texel, as the kernel has it

/// Where directions [P,3] of any length but 0, times turn [3,3] (world_from_camera, say), meet the six faces of S x S
/// texels at +x, -x, +y, -y, +z, -z -> int32 [3,P] for cube_colours. Not differentiable.
Tensor cube_taps(const Tensor& directions, const Tensor& turn, int64_t side);
/// faces [6,S,S,3], taps of that S -> [3,P], bilinear within a face. Columns of the faces at +x and -x run along y,
/// those of the others along x; rows along z, those of +z and -z along y. Any number of times differentiable in the
/// faces; the composed form is its reference.
Tensor cube_colours(const Tensor& faces, const Tensor& taps);
Tensor cube_colours_composed(const Tensor& faces, const Tensor& taps);

}  // namespace cloam
