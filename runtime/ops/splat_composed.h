// Private: the ops of gaussian splats written with general ones, by what their gradients' kernels tell apart: rows of
// gaussians and of pairs.
#pragma once
#include "runtime/ops/splat.h"

namespace cloam {

struct SplatLook {
  float blur, near;
  bool antialiased;
};
/// in: means, scales, rotations, logits, views [G,3,4], lens [6] (fx, fy, cx, cy, width, height) -> [G,7].
Tensor project_composed(const Tensors& in, const SplatLook& look);

/// in: first, rest, means, eye -> [G,3], without the cut at 0.
Tensor harmonic_sums_composed(const Tensors& in, int bands);

struct SplatPicture {
  int64_t height, width;
  int64_t across() const { return (width + 15) / 16; }
  int64_t tiles() const { return (height + 15) / 16 * across(); }
};
/// in: splats [P,7] and colours [P,C] of the pairs, offsets -> [C+1,H,W].
Tensor blend_composed(const Tensors& in, const SplatPicture& picture);

}  // namespace cloam
