// What a diffusion of codes can begin with: the best linear denoiser, to which its network adds.
#pragma once
#include "models/diffusion/code_gaussians.h"
#include "models/diffusion/noise_schedule.h"
#include "models/diffusion/unet.h"
#include "models/io/safetensors.h"

namespace cloam {

/// Wiener's filter for Gaussians of each class and time of day that share one covariance S = U diag(l) U'. With
/// y = U' (x_t - alpha m), x^ = m + U (alpha l / (alpha^2 l + sigma^2) y) and v = (alpha x_t - x^) / sigma:
///   v = -sigma m + U (alpha sigma (1 - l) / (alpha^2 l + sigma^2) y).
/// The network of a diffusion then learns what codes have beyond two moments, as preconditioning does for one variance
/// (EDM, Karras et al. 2022, section 5).
class WienerStart {
 public:
  /// Of standard normal codes of `numbers` numbers until fit() or restore(): v = 0.
  explicit WienerStart(int64_t numbers);
  void fit(const CodeGaussians& gaussians);
  bool fitted() const { return fitted_; }
  /// noisy [N, ...] at times t int32 [N], labels as asset_condition gives them -> v of noisy's shape.
  Tensor velocity(const NoiseSchedule& schedule, const Tensor& noisy, const Tensor& t,
                  const Condition& condition) const;
  /// Tensors "wiener.basis", "wiener.variances" and "wiener.means".
  TensorMap state() const;
  void restore(const TensorMap& state);

 private:
  bool fitted_ = false;
  Tensor basis_, variances_, means_;  // [d,d], [d], [(classes + 1) (times of day + 1), d]
};

}  // namespace cloam
