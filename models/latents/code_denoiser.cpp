// See code_denoiser.h.
#include "models/latents/code_denoiser.h"

#include "models/scene/asset_class.h"
#include "runtime/ops.h"

namespace cloam {

std::vector<Label> asset_labels() { return {{"class", kAssetClassCount}, {"time_of_day", kTimesOfDay}}; }

Condition asset_condition(const std::vector<int32_t>& classes, const std::vector<int32_t>& nights) {
  const auto count = static_cast<int64_t>(classes.size());
  return {{from_host(classes, {count}), from_host(nights, {count})}};
}

Tensor by_channel(const std::vector<float>& values) {
  return from_host(values, {1, static_cast<int64_t>(values.size()), 1, 1});
}

Tensor CodeDenoiser::standardised(const Tensor& codes) const {
  return (codes - by_channel(mean)) / by_channel(deviation);
}

Tensor CodeDenoiser::codes(const Tensor& standardised) const {
  return standardised * by_channel(deviation) + by_channel(mean);
}

Tensor CodeDenoiser::gradient(const Tensor& by_codes) const { return by_codes * by_channel(deviation); }

}  // namespace cloam
