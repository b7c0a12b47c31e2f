// How much signal and how much noise there is at each diffusion time, and what networks may predict of it.
// Variance preserving: x_t = alpha_t x + sigma_t e with alpha^2 + sigma^2 = 1 (Ho et al. 2020); v = alpha e - sigma x
// (Salimans and Ho 2022).
#pragma once
#include <cstdint>

#include "runtime/tensor.h"

namespace cloam {

/// Betas from 1e-4 to 0.02 in equal steps, alpha_t^2 = product of (1 - beta) up to t: DDPM's.
class LinearSchedule {
 public:
  explicit LinearSchedule(int64_t times = 1000);
  int64_t times() const { return alpha_.dim(0); }
  /// t int32 [N], 0 to times - 1; x, noise, noisy, velocity: [N, ...] of one shape.
  Tensor noisy(const Tensor& x, const Tensor& noise, const Tensor& t) const;
  Tensor velocity(const Tensor& x, const Tensor& noise, const Tensor& t) const;
  /// x and e again from x_t and (predicted) v.
  Tensor clean(const Tensor& noisy, const Tensor& velocity, const Tensor& t) const;
  Tensor noise(const Tensor& noisy, const Tensor& velocity, const Tensor& t) const;

 private:
  Tensor alpha_, sigma_;  // [times]
};

}  // namespace cloam
