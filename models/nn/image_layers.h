// Layers on images [N,C,H,W]: the blocks that U-Nets and image decoders are made of.
#pragma once
#include <optional>

#include "models/nn/layers.h"

namespace cloam {

struct ConvShape {
  int64_t in, out;
  int side = 3;       // of the kernel, odd
  int stride = 1;     // 1 keeps the image's size, 2 halves it (zeros around the image)
  float gain = 1.f;   // of the initial weights; 0: zeros
  bool half = false;  // the image is kept for the gradient in half precision
};

/// Convolution with zeros around the image, plus bias. Initial weights uniform in +-gain * sqrt(6 / (fan in + fan out))
/// (Glorot, as DDPM), bias zero.
struct Conv2d {
  Conv2d(const Scope& scope, const ConvShape& shape);
  Tensor operator()(const Tensor& x) const;
  /// The same without the bias, for callers that add more than it.
  Tensor product(const Tensor& x) const;
  /// (*this)(resize_nearest(x, 2H, 2W)) without the large input: [N,C,H,W] -> [N,K,2H,2W], kernel 3, stride 1.
  Tensor on_doubled(const Tensor& x) const;
  Tensor weight, bias;  // [K,C,side,side], [K]
  int stride;
  bool half;
};

/// Mean 0 and variance 1 over groups of channels and all places, then a scale and a shift a channel.
struct GroupNorm {
  GroupNorm(const Scope& scope, int64_t channels, int groups);
  Tensor operator()(const Tensor& x) const;
  Tensor then_silu(const Tensor& x) const;
  Tensor scale, shift;  // [C]
  int groups;
};

struct ResBlockShape {
  int64_t in, out;
  int groups = 32;
  int64_t embedding = 0;   // channels of the embedding that is projected and added between the convolutions; 0: none
  bool zero_last = false;  // the second convolution begins at zero: the block begins as its skip alone
  bool doubles = false;    // the block of the image scaled up by 2 (nearest)
  bool half = false;       // what both convolutions read is kept in half precision
};

/// Residual block, norm -> SiLU -> 3x3 -> (+ embedding) -> norm -> SiLU -> 3x3, plus the input, through a 1x1 where its
/// channels differ. That of VQGAN's decoder (Esser et al. 2021) without an embedding, that of DDPM (Ho et al. 2020)
/// with one and zero_last.
struct ResBlock {
  ResBlock(const Scope& scope, const ResBlockShape& shape);
  /// x [N,in,H,W], activated: silu of the embedding, [N,embedding] (one for all blocks) -> [N,out,H,W], or twice as
  /// large.
  Tensor operator()(const Tensor& x, const Tensor& activated = {}) const;
  GroupNorm norm1;
  Conv2d conv1;
  std::optional<Linear> project;
  GroupNorm norm2;
  Conv2d conv2;
  std::optional<Conv2d> skip;
  bool doubles;
};

struct AttentionShape {
  int64_t channels;
  int groups = 32;
  bool zero_last = false;
};

/// x + out(softmax(q k^T / sqrt C) v) over all places of the image, one head, q, k, v from the norm of x: the non-local
/// block of DDPM and VQGAN.
struct AttentionBlock {
  AttentionBlock(const Scope& scope, const AttentionShape& shape);
  Tensor operator()(const Tensor& x) const;
  GroupNorm norm;
  Linear qkv, out;
};

struct CrossAttentionShape {
  int64_t channels;
  int64_t context;  // numbers a token
  int groups = 32;
};

/// x + out(softmax(q k^T / sqrt C) v), q of the norm of x at all places, k and v of tokens [N,T,context], one head;
/// begins as x alone (latent diffusion, Rombach et al. 2022, section 3.3).
struct CrossAttentionBlock {
  CrossAttentionBlock(const Scope& scope, const CrossAttentionShape& shape);
  Tensor operator()(const Tensor& x, const Tensor& context) const;
  GroupNorm norm;
  Linear query, key_value, out;
};

}  // namespace cloam
