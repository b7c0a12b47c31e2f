// See sampler.h.
#include "models/diffusion/sampler.h"

#include <cmath>

#include "runtime/error.h"

namespace cloam {

DenoisingStep ddpm_step(const Level& from, const Level& to) {
  const double kept = from.alpha / to.alpha;  // of the signal, between the two levels
  const double added = 1 - kept * kept, variance = from.sigma * from.sigma, left = to.sigma * to.sigma;
  return {kept * left / variance, to.alpha * added / variance, std::sqrt(left / variance * added)};
}

DenoisingStep ddim_step(const Level& from, const Level& to, double eta) {
  const double drawn = eta * ddpm_step(from, to).deviation;
  // The noise that x_t is thought to hold, (x_t - alpha_t x^) / sigma_t, stays in this part.
  const double kept = std::sqrt(std::max(0.0, to.sigma * to.sigma - drawn * drawn)) / from.sigma;
  return {kept, to.alpha - kept * from.alpha, drawn};
}

Denoiser guided(const Denoiser& with, const Denoiser& without, float scale) {
  if (scale == 1.f) return with;
  return [=](const Tensor& noisy, int64_t t) {
    const Tensor base = without(noisy, t);
    return base + (with(noisy, t) - base) * scale;
  };
}

std::vector<int64_t> sampling_timesteps(int64_t timesteps, int steps) {
  if (steps < 1 || steps > timesteps)
    throw Error(Fault::usage,
                text(steps, " denoising steps: want 1 to ", timesteps, ", the timesteps of the schedule"));
  std::vector<int64_t> out;
  for (int64_t i = steps; i > 0; i--) out.push_back(i * timesteps / steps - 1);
  return out;
}

Tensor sample(const NoiseSchedule& schedule, Prediction kind, const Denoiser& denoiser, const Tensor& start,
              const SamplerOptions& options) {
  const std::vector<int64_t> timesteps = sampling_timesteps(schedule.timesteps(), options.steps);
  Tensor now = start;
  for (size_t i = 0; i < timesteps.size(); i++) {
    const Level from = schedule.level(timesteps[i]),
                to = schedule.level(i + 1 < timesteps.size() ? timesteps[i + 1] : -1);
    Tensor clean = converted(now, denoiser(now, timesteps[i]), kind, Prediction::clean, from);
    if (options.clip > 0) clean = clamp(clean, -options.clip, options.clip);
    const DenoisingStep step = ddim_step(from, to, options.eta);
    Tensor next = now * step.noisy + clean * step.clean;
    if (step.deviation > 0) {
      const RandomKey key = {options.key.seed, options.key.step, static_cast<uint32_t>(i + 1)};
      next = next + random_normal(start.shape(), key) * step.deviation;
    }
    now = stop_gradient(next);
    eval({now});
  }
  return now;
}

}  // namespace cloam
