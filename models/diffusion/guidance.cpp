// See guidance.h.
#include "models/diffusion/guidance.h"

#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr float kNoGradient = 1e-30f;  // less than any loss has, and its inverse is finite
constexpr float kMinGradient = 0.1f;   // of the largest row's: what is smaller moves less

Tensor by_row(const Tensor& values, const Tensor& like) {
  Shape shape = Shape::filled(like.rank(), 1);
  shape[0] = like.dim(0);
  return reshape(values, shape);
}

}  // namespace

Tensor distillation(const NoiseSchedule& schedule, const CleanEstimate& clean, const Tensor& x,
                    const std::vector<int32_t>& timesteps, const Tensor& noise, NetworkGradient network) {
  const auto count = static_cast<int64_t>(timesteps.size());
  std::vector<float> weights;
  for (const int32_t t : timesteps)
    weights.push_back(static_cast<float>(schedule.level(t).sigma * schedule.level(t).sigma));
  const bool through = network == NetworkGradient::included;
  const Tensor from = through ? x : stop_gradient(x);
  const Tensor estimate = clean(schedule.noisy(from, noise, from_host(timesteps, {count})), timesteps);
  const Tensor error = square(x - (through ? estimate : stop_gradient(estimate)));
  return sum(error * by_row(from_host(weights, {count}), x)) * 0.5f;
}

Tensor guided_clean(const Tensor& clean, const Tensor& gradient, const Level& level, float strength) {
  const int64_t rows = clean.dim(0), numbers = clean.numel() / rows;
  const Tensor of_row = sqrt(mean(square(reshape(gradient, {rows, numbers})), {{1}}));
  const Tensor least = maximum(max(of_row) * kMinGradient, kNoGradient);
  const Tensor scale = (strength * static_cast<float>(level.sigma)) / maximum(of_row, least);
  return clean - gradient * by_row(scale, clean);
}

}  // namespace cloam
