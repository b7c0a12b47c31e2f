// The denoiser of latents: DDPM's U-Net (Ho et al. 2020, appendix B) on small images, with class and time of day as
// conditions (GenAssets, supplement A). Predicts v (schedule.h).
#pragma once
#include <vector>

#include "models/nn/image_layers.h"

namespace cloam {

struct UnetOptions {
  int64_t channels = 32;                         // of the latent
  int64_t base = 128;                            // width at full size
  std::vector<int64_t> multipliers = {1, 2, 4};  // of the width; the image halves between one and the next
  int blocks = 2;                                // residual blocks a level
  int groups = 32;                               // of the norms
  int64_t classes = 8, times_of_day = 2;         // conditions; the number after the last says "not given"
};

/// The defaults are the paper's: 57.6 M parameters on 8x8x32. This one is for minutes on two cores.
UnetOptions small_unet();

struct UnetCondition {
  Tensor class_id, time_of_day;  // int32 [N], up to and including UnetOptions::classes, times_of_day
};

class Unet {
 public:
  explicit Unet(const Scope& scope, const UnetOptions& options = {});
  /// noisy [N,channels,H,W], H and W multiples of 2^(levels - 1); t [N] float32, the diffusion time 0 to 1000 -> v, of
  /// noisy's shape.
  Tensor operator()(const Tensor& noisy, const Tensor& t, const UnetCondition& condition) const;

 private:
  struct Down {
    std::vector<ResBlock> blocks;
    std::optional<Conv2d> halve;
  };
  struct Up {
    std::vector<ResBlock> blocks;
    std::optional<Conv2d> after_doubling;
  };
  int64_t build_down(const Scope& scope, std::vector<int64_t>& kept);
  void build_up(const Scope& scope, int64_t width, std::vector<int64_t>& kept);
  Tensor embed(const Tensor& t, const UnetCondition& condition) const;

  UnetOptions options_;
  int64_t embedding_;  // channels
  Linear time1_, time2_;
  Tensor class_table_, time_of_day_table_;
  Conv2d enter_;
  std::vector<Down> down_;
  std::optional<ResBlock> middle1_, middle2_;
  std::optional<AttentionBlock> attention_;
  std::vector<Up> up_;  // coarsest first
  GroupNorm last_norm_;
  Conv2d leave_;
};

}  // namespace cloam
