// From noise to samples: the steps of DDPM and DDIM, guidance, and the one loop that runs them for any denoiser.
#pragma once
#include <functional>
#include <vector>

#include "models/diffusion/noise_schedule.h"
#include "runtime/ops.h"

namespace cloam {

/// x_s = noisy * x_t + clean * x^ + deviation * z, with z ~ N(0, I), for a step from t to s < t.
struct DenoisingStep {
  double noisy, clean, deviation;
};
/// The mean and deviation of q(x_s | x_t, x) (Ho et al. 2020, eq. 6 and 7, for any two levels).
DenoisingStep ddpm_step(const Level& from, const Level& to);
/// Song et al. 2021, eq. 12 and 16: eta 0 draws nothing, eta 1 is ddpm_step.
DenoisingStep ddim_step(const Level& from, const Level& to, double eta);

/// An estimate, of the kind that the sampler is told, from x_t at time t of the schedule.
using Denoiser = std::function<Tensor(const Tensor& noisy, int64_t t)>;

/// Classifier-free guidance (Ho and Salimans 2022): without + scale (with - without). Scale 1 is `with` alone, which
/// then alone is computed; above 1 samples keep closer to the condition and vary less.
Denoiser guided(const Denoiser& with, const Denoiser& without, float scale);

struct SamplerOptions {
  int steps = 50;
  double eta = 0;      // of DDIM; 1 with as many steps as the schedule has times: DDPM's ancestral sampling
  float clip = 0;      // bound on |x^|; 0: none
  RandomKey key = {};  // of what is drawn on the way (eta above 0); stream i + 1 in step i
};

/// Times of `steps` even steps, the last time of the schedule first: sampling begins where nothing but noise is left.
/// Fault::usage unless steps is 1 to `times`.
std::vector<int64_t> sampling_timesteps(int64_t timesteps, int steps);

/// `start`: noise N(0, I), of the samples' shape -> samples. The denoiser is called once a step, with evaluated leaves.
/// A method that corrects x^ on the way (by the gradient of a rendering, say) does so in its denoiser.
Tensor sample(const NoiseSchedule& schedule, Prediction kind, const Denoiser& denoiser, const Tensor& start,
              const SamplerOptions& options = {});

}  // namespace cloam
