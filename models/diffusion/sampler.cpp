// See sampler.h.
#include "models/diffusion/sampler.h"

#include "runtime/error.h"

namespace cloam {

DenoisingStep ddim_step(const Level& from, const Level& to) {
  // The noise that x_t is thought to hold, (x_t - alpha_t x^) / sigma_t, stays in this part.
  const double kept = to.sigma / from.sigma;
  return {kept, to.alpha - kept * from.alpha};
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

Tensor sample(const NoiseSchedule& schedule, const Denoiser& denoiser, const Tensor& start, int steps) {
  const std::vector<int64_t> timesteps = sampling_timesteps(schedule.timesteps(), steps);
  Tensor now = start;
  for (size_t i = 0; i < timesteps.size(); i++) {
    const Level from = schedule.level(timesteps[i]),
                to = schedule.level(i + 1 < timesteps.size() ? timesteps[i + 1] : -1);
    const Tensor clean = now * from.alpha + denoiser(now, timesteps[i]) * -from.sigma;
    const DenoisingStep step = ddim_step(from, to);
    now = stop_gradient(now * step.noisy + clean * step.clean);
    eval({now});
  }
  return now;
}

}  // namespace cloam
