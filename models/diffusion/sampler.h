// From noise to samples: the steps of DDIM, guidance, and the one loop that runs them for any denoiser.
#pragma once
#include <functional>
#include <vector>

#include "models/diffusion/noise_schedule.h"
#include "runtime/ops.h"

namespace cloam {

/// x_s = noisy * x_t + clean * x^ for a step from t to s < t.
struct DenoisingStep {
  double noisy, clean;
};
/// Without noise on the way (Song et al. 2021, eq. 12, sigma 0).
DenoisingStep ddim_step(const Level& from, const Level& to);

/// The v of x_t at time t of the schedule.
using Denoiser = std::function<Tensor(const Tensor& noisy, int64_t t)>;

/// Classifier-free guidance (Ho and Salimans 2022): without + scale (with - without). Scale 1 is `with` alone, which
/// then alone is computed; above 1 samples keep closer to the condition and vary less.
Denoiser guided(const Denoiser& with, const Denoiser& without, float scale);

/// Times of `steps` even steps, the last time of the schedule first: sampling begins where nothing but noise is left.
/// Fault::usage unless steps is 1 to `times`.
std::vector<int64_t> sampling_timesteps(int64_t timesteps, int steps);

/// `start`: noise N(0, I), of the samples' shape -> samples. The denoiser is called once a step, with evaluated leaves.
/// A method that corrects x^ on the way (by the gradient of a rendering, say) does so in its denoiser.
Tensor sample(const NoiseSchedule& schedule, const Denoiser& denoiser, const Tensor& start, int steps);

}  // namespace cloam
