// The network of a diffusion of codes: as it is trained, and with the average of its weights, which evaluation and
// sampling use.
#pragma once
#include <optional>

#include "models/io/safetensors.h"
#include "models/latents/code_denoiser.h"
#include "models/latents/wiener_start.h"
#include "models/nn/ema.h"

namespace cloam {

class CodeNetwork {
 public:
  /// The average begins as the network itself. start: what the network adds to; without it, nothing.
  CodeNetwork(const UnetOptions& options, const NoiseSchedule& schedule, uint64_t seed,
              std::optional<WienerStart> start = {});
  enum class Weights { trained, averaged };
  /// The v that it predicts for noisy [N,C,H,W] at times t int32 [N].
  Tensor velocity(Weights weights, const Tensor& noisy, const Tensor& t, const Condition& condition) const;
  /// After step `step`, counted from 1.
  void average(double decay, int64_t step) { update_ema(ema_, params_, warm_decay(decay, step)); }
  const NoiseSchedule& schedule() const { return schedule_; }
  std::optional<WienerStart>& start() { return start_; }
  Params& parameters() { return params_; }
  const Params& parameters() const { return params_; }
  /// The average, under "ema.", and the start.
  TensorMap state() const;
  void restore(const TensorMap& state);

 private:
  NoiseSchedule schedule_;
  std::optional<WienerStart> start_;
  Params params_, ema_;  // of one set of names
  Unet unet_, ema_unet_;
};

}  // namespace cloam
