// The denoiser of latents: DDPM's U-Net (Ho et al. 2020, appendix B) on small images. What it is conditioned on is
// data: labels as added embeddings (GenAssets, supplement A), images concatenated to the input (as Zero-1-to-3 and
// CAT3D do), tokens by cross-attention (latent diffusion, Rombach et al. 2022).
#pragma once
#include <string>
#include <vector>

#include "models/nn/image_layers.h"

namespace cloam {

/// A label that a sample may have: values 0 to count - 1, and count for "not given".
struct Label {
  std::string name;
  int64_t count;
};

/// The defaults are the paper's: 57.6 M parameters on 8x8x32.
struct UnetOptions {
  int64_t channels = 32;                         // of the latent
  int64_t base = 128;                            // width at full size
  std::vector<int64_t> multipliers = {1, 2, 4};  // of the width; the image halves between one and the next
  int blocks = 2;                                // residual blocks a level
  int groups = 32;                               // of the norms
  bool half = false;                             // what convolutions read of norms is kept in half precision
  std::vector<Label> labels = {{"class", 8}, {"time_of_day", 2}};  // added embeddings
  int64_t image_channels = 0;                                      // of images that are concatenated; 0: none
  int64_t context_width = 0;                                       // of tokens for cross-attention; 0: none
};

/// Of N samples; parts that the network was not made for stay empty.
struct Condition {
  Tensors labels = {};  // int32 [N], one for each of UnetOptions::labels
  Tensor image = {};    // [N,image_channels,H,W]
  Tensor context = {};  // [N,T,context_width]: tokens
};

class Unet {
 public:
  explicit Unet(const Scope& scope, const UnetOptions& options = {});
  /// noisy [N,channels,H,W], H and W multiples of 2^(levels - 1); t [N] float32, the diffusion time 0 to 1000 -> v, of
  /// noisy's shape.
  Tensor operator()(const Tensor& noisy, const Tensor& t, const Condition& condition) const;

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
  void check(const Tensor& noisy, const Condition& condition) const;
  Tensor embed(const Tensor& t, const Condition& condition) const;

  UnetOptions options_;
  int64_t embedding_;  // channels
  Linear time1_, time2_;
  Tensors label_tables_;
  Conv2d enter_;
  std::vector<Down> down_;
  std::optional<ResBlock> middle1_, middle2_;
  std::optional<AttentionBlock> attention_;
  std::optional<CrossAttentionBlock> cross_attention_;
  std::vector<Up> up_;  // coarsest first
  GroupNorm last_norm_;
  Conv2d leave_;
};

}  // namespace cloam
