// See pixel_targets.h.
#include "models/batches/pixel_targets.h"

#include "models/batches/own_rows.h"

namespace cloam {
namespace {

constexpr float kLeastDepth = 1e-6f;  // in units of any kind: no sum of two lengths is less

}  // namespace

Tensor background_of(const BackgroundKind& which, int64_t rays, const RandomKey& key, const Share& share) {
  const bool random = which.kind == "random" || (which.kind == "auto" && which.is_random_auto);
  if (random) return own_rows(random_uniform({rays, 3}, key), share);
  return full({1, 3}, which.kind == "white" ? 1.f : 0.f);
}

Tensor truth_over(const Tensor& background, const PixelBatch& batch, bool has_alpha) {
  const Tensor rgb = slice(batch.rgba, 1, 0, 3), alpha = slice(batch.rgba, 1, 3, 4);
  return has_alpha ? rgb * alpha + background * (1.f - alpha) : rgb;
}

Tensor pixel_loss(const std::string& kind, const Tensor& rendered, const Tensor& truth, const Tensor& used) {
  Tensor error = square(rendered - truth);
  if (kind == "charbonnier") error = sqrt(error + 1e-6f);
  return used ? mean(error * unsqueeze(used, 1)) : mean(error);
}

Tensor depth_errors(const Tensor& lengths, const Tensor& depths) {
  return where(depths > 0.f, abs(lengths - depths) / maximum(lengths + depths, kLeastDepth), 0.f);
}

Tensor depth_loss(const DepthSamples& samples, const Tensor& depths) {
  const auto known = [](const Tensor& of) { return cast(of > 0.f, DType::f32); };
  const Tensor near = known(samples.depths) - depth_errors(samples.lengths, samples.depths);
  return (sum(known(depths)) - sum(samples.weights * near)) * (1.f / static_cast<float>(depths.numel()));
}

}  // namespace cloam
