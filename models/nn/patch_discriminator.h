// The discriminator of pix2pix (Isola et al. 2017, section 3.2.2): tells real from rendered patch by patch.
#pragma once
#include <vector>

#include "models/nn/image_layers.h"

namespace cloam {

/// Convolutions 4x4 with stride 2 and LeakyReLU 0.2 behind each, InstanceNorm before it but in the first, then a 1x1 of
/// one channel: images [N,3,H,W] of any values near [0,1] -> logits [N,1,h,w], positive for real. H and W are multiples
/// of 2^widths, at least twice that: InstanceNorm of a single place is always zero.
struct PatchDiscriminator {
  PatchDiscriminator(const Scope& scope, const std::vector<int64_t>& widths = {64, 128, 256, 512});
  Tensor operator()(const Tensor& images) const;
  struct Block {
    Tensor weight, bias;  // no bias where a norm takes it away
  };
  std::vector<Block> blocks;
  Block last;
};

/// Mean over all logits of the cross entropy with `target` (1: real, 0: fake), by log(1 + e^x) - target x: no overflow.
Tensor bce_with_logits(const Tensor& logits, float target);

}  // namespace cloam
