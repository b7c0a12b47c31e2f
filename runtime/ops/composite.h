// Light along rays: the share that each sample sends back, and sums over them (kernels/composite.cl has the maths).
#pragma once
#include "runtime/ops.h"

namespace cloam {

/// What light passes through. Ray r has the places [offsets[r], offsets[r+1]), front to back; place i is row rows[i] of
/// what lies by row, so that a ray's samples may be of several lists. Every row has one place.
struct Medium {
  Tensor matter;     // [S] by row: opacity in [0,1] or, with dt, density >= 0
  Tensor offsets;    // int32 [R+1]
  Tensor dt = {};    // [S] by row: lengths of the samples' intervals; no gradient
  Tensor rows = {};  // int32 [S]; empty: place i is row i
  bool sky = false;  // the last sample of a ray takes the light that is left; no opacity counts places of t < 0
};
/// The weights T alpha [S] by place. Any number of times differentiable in matter; the composed form is its reference.
Tensor composite_weights(const Medium& medium);
Tensor composite_weights_composed(const Medium& medium);

/// What is seen in it.
struct Contents {
  Tensor features;     // [S,C] by row
  Tensor t;            // [S] by place: |t| is the distance, ascending along a ray; no gradient
  Tensor ranges = {};  // [R]: where a LiDAR saw something, 0: it did not look
  float near = 0;      // around ranges, where matter belongs
  int64_t split = 0;   // with ranges: rows from here on have an opacity of their own
};
/// -> [R,C+3]: sum of w f; opacity; depth (sum of w |t|, not divided by opacity); distortion (mip-NeRF 360 eq. 15 over
/// t / (1 + t); 0 without dt). With ranges [R,C+5]: also the sum of w^2 of what is not near the range, and the sum of w
/// of rows from `split` on. Any number of times differentiable in matter and features; the composed form is its
/// reference.
Tensor composite(const Medium& medium, const Contents& seen);
Tensor composite_composed(const Medium& medium, const Contents& seen);

}  // namespace cloam
