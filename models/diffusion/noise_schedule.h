// How much signal and how much noise there is at each diffusion time, and what networks may predict of it.
// Variance preserving: x_t = alpha_t x + sigma_t e with alpha^2 + sigma^2 = 1 (Ho et al. 2020); v = alpha e - sigma x
// (Salimans and Ho 2022).
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "runtime/tensor.h"

namespace cloam {

/// linear: betas from 1e-4 to 0.02 in equal steps (DDPM). cosine: alpha^2 falls as a squared cosine, s = 0.008, betas
/// up to 0.999 (Nichol and Dhariwal 2021). scaled_linear: square roots of betas in equal steps, 0.00085 to 0.012
/// (latent diffusion, Rombach et al. 2022).
enum class Betas { linear, cosine, scaled_linear };
/// "linear", "cosine" or "scaled-linear". Fault::usage.
Betas betas_named(const std::string& name);

/// What a network predicts of x_t: the noise e, the clean x, or v.
enum class Prediction { noise, clean, velocity };

struct Level {
  double alpha = 1, sigma = 0;
};

/// How one prediction is made from another and x_t: noisy * x_t + predicted * p.
struct Conversion {
  double noisy = 0, predicted = 1;
};
/// e from x divides by sigma, x from e by alpha: at levels where those are 0 there is no conversion, and the numbers
/// are not finite.
Conversion conversion(Prediction from, Prediction to, const Level& level);
/// The same applied; noisy and predicted: tensors of one shape, all of them at that level.
Tensor converted(const Tensor& noisy, const Tensor& predicted, Prediction from, Prediction to, const Level& level);

class NoiseSchedule {
 public:
  /// alpha_t^2 = product of (1 - beta) up to t, t = 0 to times - 1. Fault::usage for no time.
  explicit NoiseSchedule(Betas betas = Betas::linear, int64_t timesteps = 1000);
  int64_t timesteps() const { return static_cast<int64_t>(levels_.size()); }
  /// t = -1 is the clean end: alpha 1, sigma 0.
  Level level(int64_t t) const { return t < 0 ? Level{} : levels_.at(static_cast<size_t>(t)); }
  /// t int32 [N], 0 to times - 1; x and noise: [N, ...] of one shape.
  Tensor noisy(const Tensor& x, const Tensor& noise, const Tensor& t) const;
  /// The x that velocities [N, ...] at times t [N] say of noisy: alpha_t noisy - sigma_t velocity.
  Tensor clean(const Tensor& noisy, const Tensor& velocity, const Tensor& t) const;
  /// What a network that predicts `kind` is to say of noisy(x, noise, t).
  Tensor target(Prediction kind, const Tensor& x, const Tensor& noise, const Tensor& t) const;
  /// Min-SNR-gamma (Hang et al. 2023) [N]: times of little noise count as if their signal-to-noise ratio alpha^2 /
  /// sigma^2 were gamma at most. min(SNR, gamma), over SNR for noise, over SNR + 1 for velocity, in whose units errors
  /// of x are so much smaller.
  Tensor min_snr_weights(Prediction kind, double gamma, const Tensor& t) const;

 private:
  std::vector<Level> levels_;
  Tensor alpha_, sigma_;  // [times]
};

/// min_snr_weights of one level.
double min_snr_weight(Prediction kind, double gamma, const Level& level);

}  // namespace cloam
