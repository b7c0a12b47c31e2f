// What a diffusion of latent codes knows, for those that use it as a prior.
#pragma once
#include <functional>
#include <vector>

#include "models/diffusion/noise_schedule.h"
#include "models/diffusion/unet.h"

namespace cloam {

struct CodeDenoiser {
  NoiseSchedule schedule;
  int64_t side = 0;                    // of a code; its channels are as many as
  std::vector<float> mean, deviation;  // these: x = (code - mean) / deviation
  /// The estimate x^ [N,C,side,side] of what noisy ones of that shape were, at times [N] of the schedule.
  std::function<Tensor(const Tensor& noisy, const std::vector<int32_t>& times, const Condition& condition)> clean;
  /// Codes, as they are, that it learned from: of a class and time of day (1: night); of the class, or of all, where
  /// there are none. Empty unless the run that it learned from is loaded.
  std::function<std::vector<std::vector<float>>(int32_t asset_class, int32_t night)> examples = {};

  Tensor standardised(const Tensor& codes) const;
  Tensor codes(const Tensor& standardised) const;
  /// d loss / d codes -> d loss / d standardised.
  Tensor gradient(const Tensor& by_codes) const;
};

/// What a diffusion of assets' codes is conditioned on.
std::vector<Label> asset_labels();
/// Classes (asset_class.h; kAssetClassCount: not given) and times of day (1: night; kTimesOfDay: not given) of N
/// assets.
constexpr int kTimesOfDay = 2;
Condition asset_condition(const std::vector<int32_t>& classes, const std::vector<int32_t>& nights);

/// One value a channel, to stand before [N,C,H,W].
Tensor by_channel(const std::vector<float>& values);

}  // namespace cloam
