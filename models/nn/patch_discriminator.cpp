// See patch_discriminator.h.
#include "models/nn/patch_discriminator.h"

#include <cmath>

#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kSide = 4;
constexpr float kSlope = 0.2f;

/// Uniform with the deviation that He et al. 2015 give for leaky ReLUs.
Tensor weights(const Scope& scope, int64_t out, int64_t in, int64_t side) {
  const float fan_in = static_cast<float>(in * side * side);
  return scope.uniform("weight", {out, in, side, side}, std::sqrt(6.f / ((1 + kSlope * kSlope) * fan_in)));
}

}  // namespace

PatchDiscriminator::PatchDiscriminator(const Scope& scope, const std::vector<int64_t>& widths) {
  int64_t in = 3;
  for (const int64_t width : widths) {
    const Scope here = scope / ("block" + std::to_string(blocks.size()));
    const Tensor bias = blocks.empty() ? here.constant("bias", {width}, 0.f) : Tensor();
    blocks.push_back({weights(here, width, in, kSide), bias});
    in = width;
  }
  last = {weights(scope / "last", 1, in, 1), (scope / "last").constant("bias", {1}, 0.f)};
}

Tensor PatchDiscriminator::operator()(const Tensor& images) const {
  const Dims d = match("patch_discriminator", {{"images", images, "N 3 H W"}});
  const int64_t least = int64_t{2} << blocks.size();
  if (d["H"] < least || d["W"] < least || d["H"] % (least / 2) != 0 || d["W"] % (least / 2) != 0)
    throw Error(Fault::internal, text("[patch_discriminator] images ", to_string(images.shape()),
                                      ": want multiples of ", least / 2, " from ", least));
  Tensor x = 2.f * images - 1.f;
  for (const Block& block : blocks) {
    x = conv2d(x, block.weight, {.stride = 2, .pad = 1}, {.bias = block.bias});
    if (!block.bias) x = group_norm(x, static_cast<int>(x.dim(1)), {}, {});
    x = leaky_relu(x, kSlope);
  }
  return conv2d(x, last.weight, {}, {.bias = last.bias});
}

Tensor bce_with_logits(const Tensor& logits, float target) { return mean(softplus(logits) - target * logits); }

}  // namespace cloam
