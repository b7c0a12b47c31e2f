// See code_network.h.
#include "models/latents/code_network.h"

#include "models/io/tensors.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr int64_t kNetworkTimes = 1000;  // the scale of times that the U-Net's encoding is made for

}  // namespace

CodeNetwork::CodeNetwork(const UnetOptions& options, const NoiseSchedule& schedule, uint64_t seed,
                         std::optional<WienerStart> start)
    : schedule_(schedule),
      start_(std::move(start)),
      unet_(Scope{params_, "unet", seed}, options),
      ema_unet_(Scope{ema_, "unet", seed}, options) {}

Tensor CodeNetwork::velocity(Weights weights, const Tensor& noisy, const Tensor& t, const Condition& condition) const {
  const float scale = static_cast<float>(kNetworkTimes) / static_cast<float>(schedule_.timesteps());
  const Unet& unet = weights == Weights::averaged ? ema_unet_ : unet_;
  const Tensor v = unet(noisy, cast(t, DType::f32) * scale, condition);
  return start_ ? v + start_->velocity(schedule_, noisy, t, condition) : v;
}

TensorMap CodeNetwork::state() const {
  TensorMap out;
  for (const auto& [name, mean] : ema_) out["ema." + name] = named(mean);
  if (start_) out.merge(start_->state());
  return out;
}

void CodeNetwork::restore(const TensorMap& state) {
  std::vector<std::pair<Tensor, Tensor>> updates;
  for (const auto& [name, mean] : ema_) updates.push_back({mean, tensor_from(state, "ema." + name, mean.shape())});
  assign(updates);
  if (start_) start_->restore(state);
}

}  // namespace cloam
