// Pictures compared (ops/ssim.cpp).
#pragma once
#include "runtime/ops.h"

namespace cloam {

/// Means over all values, scalars. With y a photograph, Gaussian splatting's loss is 0.8 l1 + 0.2 (1 - ssim).
struct Likeness {
  Tensor l1;    // of |x - y|
  Tensor ssim;  // Wang et al. 2004: Gaussian window of 11 x 11 with sigma 1.5, zeros around the picture, values up to 1
};
/// x, y [C,H,W]. Any number of times differentiable in x, no gradient to y; the composed form is the reference. What a
/// mask leaves out the caller makes black in both.
Likeness likeness(const Tensor& x, const Tensor& y);
Likeness likeness_composed(const Tensor& x, const Tensor& y);

}  // namespace cloam
