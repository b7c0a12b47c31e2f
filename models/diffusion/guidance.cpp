// See guidance.h.
#include "models/diffusion/guidance.h"

#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr float kNoGradient = 1e-30f;   // less than any loss has, and its inverse is finite
constexpr float kLeastGradient = 0.1f;  // of the largest row's: what is smaller moves less

/// One value a channel, to stand before [N,C,H,W].
Tensor by_channel(const std::vector<float>& values) {
  return from_host(values, {1, static_cast<int64_t>(values.size()), 1, 1});
}

Tensor by_row(const Tensor& values, const Tensor& like) {
  Shape shape = Shape::filled(like.rank(), 1);
  shape[0] = like.dim(0);
  return reshape(values, shape);
}

}  // namespace

Tensor CodeDenoiser::standardised(const Tensor& codes) const {
  return (codes - by_channel(mean)) / by_channel(deviation);
}

Tensor CodeDenoiser::codes(const Tensor& standardised) const {
  return standardised * by_channel(deviation) + by_channel(mean);
}

Tensor CodeDenoiser::gradient(const Tensor& by_codes) const { return by_codes * by_channel(deviation); }

Tensor distillation(const Schedule& schedule, const CleanEstimate& clean, const Tensor& x,
                    const std::vector<int32_t>& times, const Tensor& noise, NetworkGradient network) {
  const auto count = static_cast<int64_t>(times.size());
  std::vector<float> weights;
  for (const int32_t t : times)
    weights.push_back(static_cast<float>(schedule.level(t).sigma * schedule.level(t).sigma));
  const bool through = network == NetworkGradient::included;
  const Tensor from = through ? x : stop_gradient(x);
  const Tensor estimate = clean(schedule.noisy(from, noise, from_host(times, {count})), times);
  const Tensor error = square(x - (through ? estimate : stop_gradient(estimate)));
  return sum(error * by_row(from_host(weights, {count}), x)) * 0.5f;
}

Tensor guided_clean(const Tensor& clean, const Tensor& gradient, const Level& level, float strength) {
  const int64_t rows = clean.dim(0), numbers = clean.numel() / rows;
  const Tensor of_row = sqrt(mean(square(reshape(gradient, {rows, numbers})), {{1}}));
  const Tensor least = maximum(max(of_row) * kLeastGradient, kNoGradient);
  const Tensor scale = (strength * static_cast<float>(level.sigma)) / maximum(of_row, least);
  return clean - gradient * by_row(scale, clean);
}

}  // namespace cloam
