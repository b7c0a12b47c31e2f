// Layers on images.
#include "models/nn/image_layers.h"

#include <cmath>

#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

float glorot(const ConvShape& s) {
  return s.gain * std::sqrt(6.f / static_cast<float>((s.in + s.out) * s.side * s.side));
}

/// A number a channel [C] or a channel and image [N,C], in front of every place.
Tensor over_places(const Tensor& x) {
  const Shape& s = x.shape();
  return reshape(x, x.rank() == 1 ? Shape{1, s[0], 1, 1} : Shape{s[0], s[1], 1, 1});
}

/// [9,16]: 3x3 weights to the four 2x2 kernels that an image meets when all its pixels are there twice an axis. There,
/// even results meet pixels i-1, i, i and odd ones i, i, i+1: two taps, the doubled one with the sum of two weights.
Tensor kernels_of_doubled() {
  // [tap of three][even or odd][tap of two]
  constexpr float kAxis[3][2][2] = {{{1, 0}, {1, 0}}, {{0, 1}, {1, 0}}, {{0, 1}, {0, 1}}};
  std::vector<float> both;
  for (int tap = 0; tap < 9; tap++)
    for (int place = 0; place < 16; place++)
      both.push_back(kAxis[tap / 3][place / 8][place / 2 % 2] * kAxis[tap % 3][place / 4 % 2][place % 2]);
  return from_host(both, {9, 16});
}

/// Scaled up by 2, seen as [N,C,H,2,W,2]: no copy.
Tensor doubled_view(const Tensor& x) {
  return broadcast_to(reshape(x, {x.dim(0), x.dim(1), x.dim(2), 1, x.dim(3), 1}),
                      {x.dim(0), x.dim(1), x.dim(2), 2, x.dim(3), 2});
}

}  // namespace

Conv2d::Conv2d(const Scope& scope, const ConvShape& s)
    : weight(scope.uniform("weight", {s.out, s.in, s.side, s.side}, glorot(s))),
      bias(scope.constant("bias", {s.out}, 0.f)),
      stride(s.stride),
      half(s.half) {}

Tensor Conv2d::operator()(const Tensor& x) const { return product(x) + over_places(bias); }

Tensor Conv2d::product(const Tensor& x) const {
  return conv2d(half ? cast(x, DType::f16) : x, weight, {stride, static_cast<int>(weight.dim(2) / 2), 1});
}

// Results at even and odd rows and columns are four convolutions of the small image with 2x2 kernels: 4 multiply-adds
// where the large image takes 9 (the sub-pixel convolution of Shi et al. 2016, run backwards). Making the kernels costs
// more than it saves where there are few pixels.
Tensor Conv2d::on_doubled(const Tensor& x) const {
  constexpr int64_t kFewPixels = 256;
  const int64_t n = x.dim(0), c = x.dim(1), h = x.dim(2), w = x.dim(3), k = weight.dim(0);
  if (n * h * w < kFewPixels) return (*this)(resize_nearest(x, 2 * h, 2 * w));
  const Tensor by_place = reshape(matmul(reshape(weight, {k * c, 9}), kernels_of_doubled()), {k, c, 4, 2, 2});
  const Tensor kernels = reshape(permute(by_place, {2, 0, 1, 3, 4}), {4 * k, c, 2, 2});
  const Tensor shifted = reshape(unfold(reshape(x, {n, c, h, w, 1}), {2, 2, 1, 1}), {n, 4 * c, h + 1, w + 1});
  const Tensor quarters =
      reshape(conv2d(half ? cast(shifted, DType::f16) : shifted, kernels, {1, 0, 4}), {n, 2, 2, k, h, w});
  return reshape(permute(quarters, {0, 3, 4, 1, 5, 2}), {n, k, 2 * h, 2 * w}) + over_places(bias);
}

GroupNorm::GroupNorm(const Scope& scope, int64_t channels, int number)
    : scale(scope.constant("scale", {channels}, 1.f)),
      shift(scope.constant("shift", {channels}, 0.f)),
      groups(number) {}

Tensor GroupNorm::operator()(const Tensor& x) const { return group_norm(x, groups, scale, shift); }
Tensor GroupNorm::then_silu(const Tensor& x) const { return group_norm(x, groups, scale, shift, {.silu = true}); }

ResBlock::ResBlock(const Scope& scope, const ResBlockShape& s)
    : norm1(scope / "norm1", s.in, s.groups),
      conv1(scope / "conv1", {.in = s.in, .out = s.out, .half = s.half}),
      norm2(scope / "norm2", s.out, s.groups),
      conv2(scope / "conv2", {s.out, s.out, 3, 1, s.zero_last ? 0.f : 1.f, s.half}),
      doubles(s.doubles) {
  if (s.embedding > 0) project.emplace(scope / "project", s.embedding, s.out);
  if (s.in != s.out) skip.emplace(scope / "skip", ConvShape{s.in, s.out, 1});
}

// Scaling up repeats pixels, so it changes neither the statistics of a norm nor what SiLU and a 1x1 do to a pixel: they
// run on the small image.
Tensor ResBlock::operator()(const Tensor& x, const Tensor& activated) const {
  const Tensor entered = norm1.then_silu(x);
  Tensor h = doubles ? conv1.on_doubled(entered) : conv1(entered);
  if (project) h = h + over_places((*project)(activated));
  h = conv2(norm2.then_silu(h));
  const Tensor kept = skip ? (*skip)(x) : x;
  if (!doubles) return h + kept;
  const Tensor large = doubled_view(kept);
  return reshape(reshape(h, large.shape()) + large, h.shape());
}

AttentionBlock::AttentionBlock(const Scope& scope, const AttentionShape& s)
    : norm(scope / "norm", s.channels, s.groups),
      qkv(scope / "qkv", s.channels, 3 * s.channels),
      out(scope / "out", s.channels, s.channels, s.zero_last ? 0.f : 1.f) {}

namespace {

/// [N,C,H,W] to rows [N,HW,C], and back to the shape of `like`.
Tensor rows_of(const Tensor& x) { return permute(reshape(x, {x.dim(0), x.dim(1), x.dim(2) * x.dim(3)}), {0, 2, 1}); }
Tensor image_of(const Tensor& rows, const Tensor& like) { return reshape(permute(rows, {0, 2, 1}), like.shape()); }

}  // namespace

Tensor AttentionBlock::operator()(const Tensor& x) const {
  const int64_t c = x.dim(1);
  const Tensors parts = split(qkv(rows_of(norm(x))), 2, {c, c, c});
  return x + image_of(out(attention(parts[0], parts[1], parts[2])), x);
}

CrossAttentionBlock::CrossAttentionBlock(const Scope& scope, const CrossAttentionShape& s)
    : norm(scope / "norm", s.channels, s.groups),
      query(scope / "query", s.channels, s.channels),
      key_value(scope / "key_value", s.context, 2 * s.channels),
      out(scope / "out", s.channels, s.channels, 0.f) {}

Tensor CrossAttentionBlock::operator()(const Tensor& x, const Tensor& context) const {
  const int64_t c = x.dim(1);
  const Tensors parts = split(key_value(context), 2, {c, c});
  return x + image_of(out(attention(query(rows_of(norm(x))), parts[0], parts[1])), x);
}

}  // namespace cloam
