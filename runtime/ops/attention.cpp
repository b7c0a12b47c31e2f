// Attention (Vaswani et al. 2017, equation 1): a kernel that keeps no matrix of scores, and the composition that it
// stands for.
#include <algorithm>
#include <cmath>

#include "runtime/cl.h"
#include "runtime/ops.h"
#include "runtime/ops/composed.h"

namespace cloam {
namespace {

const Registered kRegistered("attention");

int64_t ceil_div(int64_t a, int64_t b) { return (a + b - 1) / b; }

/// q [B,T,D], k [B,U,D], v [B,U,E].
struct AttentionSizes {
  int64_t B, T, U, D, E;
  float scale;
  double pair_flops(int64_t products_d, int64_t products_e) const {
    return 2.0 * static_cast<double>(B * T * U) * static_cast<double>(products_d * D + products_e * E);
  }
};

Tensor attention_composed(const Tensors& in, float scale) {
  return matmul(softmax(matmul(in[0], transpose(in[1])) * scale, -1), in[2]);
}

constexpr int64_t kWidest = 512;

const Variant& variant(const AttentionSizes& s, bool gradient) {
  const int64_t width = std::max(s.D, s.E);
  if (width <= 64) return choose("attention", gradient ? "narrow_grad" : "narrow");
  if (width <= 128) return choose("attention", gradient ? "medium_grad" : "medium");
  return choose("attention", gradient ? "wide_grad" : "wide");
}

cl::Kernel& kernel_for(const Variant& v, const AttentionSizes& s) {
  return kernel(v, {{"D", static_cast<int>(s.D)}, {"E", static_cast<int>(s.E)}});
}

struct Attention final : Op {
  explicit Attention(const AttentionSizes& s) : sizes(s) {}
  const char* name() const override { return "attention"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override;
  AttentionSizes sizes;
  mutable Tensor logs;  // [B,T]: logarithms of the sums of the softmax, for the gradient
};

void Attention::run(const Tensors& in, Tensor& out) const {
  const AttentionSizes& s = sizes;
  const Variant& v = variant(s, false);
  logs = empty({s.B, s.T});
  Range range = range2(ceil_div(s.T, v["BQ"]), s.B);
  range.flops = s.pair_flops(1, 1);
  launch(kernel_for(v, s), "attention", range, in[0], in[1], in[2], out, logs, s.T, s.U, s.scale);
}

/// Inputs q, k, v, g and the sums of g * result over its rows -> packed gradients of q, k, v.
struct AttentionGrad final : Op {
  explicit AttentionGrad(std::shared_ptr<const Attention> op) : forward(std::move(op)) {}
  const char* name() const override { return "attention_grad"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override;
  std::shared_ptr<const Attention> forward;
};

void AttentionGrad::run(const Tensors& in, Tensor& out) const {
  const AttentionSizes& s = forward->sizes;
  const Variant& v = variant(s, true);
  // Parts of the keys, each with its own sum of dq: enough of them for the cores, by the sizes alone.
  const int64_t blocks = ceil_div(s.U, v["BK"]);
  const int64_t each = ceil_div(blocks, std::clamp<int64_t>(16 / s.B, 1, blocks)), parts = ceil_div(blocks, each);
  const int64_t count = s.B * s.T * s.D;
  const Tensor to = parts == 1 ? out : empty({parts, count});
  Range range = range2(parts, s.B);
  range.flops = s.pair_flops(3, 2);
  launch(kernel_for(v, s), "attention_grad", range, in[0], in[1], in[2], in[3], forward->logs, in[4], to, out, s.T, s.U,
         s.scale, each);
  if (parts == 1) return;
  constexpr int64_t kChunk = 4096;
  launch(kernel(v.stem.c_str(), "attention_sum", {{"BQ", 8}, {"BK", 32}, {"D", 1}, {"E", 1}}), "attention_sum",
         range1(ceil_div(count, kChunk)), to, out, count, parts, kChunk);
}

// delta is a function of the other inputs: its own gradient is left out, and counted in theirs.
Tensors AttentionGrad::vjp(const Tensors& in, const Tensor&, const Tensor& g) const {
  const float scale = forward->sizes.scale;
  const auto composed = [scale](const Tensors& of) {
    const auto plain = [scale](const Tensors& x) { return attention_composed(x, scale); };
    return packed(vjp_of(plain, {of[0], of[1], of[2]}, of[3]));
  };
  Tensors parts = vjp_of(composed, {in[0], in[1], in[2], in[3]}, g);
  parts.emplace_back();
  return parts;
}

Tensors Attention::vjp(const Tensors& in, const Tensor& out, const Tensor& g) const {
  const AttentionSizes& s = sizes;
  const Tensor delta = stop_gradient(sum(g * out, {{-1}}));
  const Tensor all = make(std::make_shared<AttentionGrad>(std::static_pointer_cast<const Attention>(shared())),
                          {in[0].numel() + in[1].numel() + in[2].numel()}, {in[0], in[1], in[2], g, delta});
  return unpacked(all, {{s.B, s.T, s.D}, {s.B, s.U, s.D}, {s.B, s.U, s.E}});
}

Shape leading(const Tensor& x) {
  Shape out;
  for (int i = 0; i + 2 < x.rank(); i++) out.push_back(x.dim(i));
  return out;
}
Tensor flattened(const Tensor& x) { return reshape(x, {numel(leading(x)), x.dim(-2), x.dim(-1)}); }

}  // namespace

Tensor attention(const Tensor& q, const Tensor& k, const Tensor& v, float scale) {
  if (q.rank() > 3 && leading(q) == leading(k) && leading(q) == leading(v)) {
    Shape shape = leading(q);
    shape.push_back(q.dim(-2));
    shape.push_back(v.dim(-1));
    return reshape(attention(flattened(q), flattened(k), flattened(v), scale), shape);
  }
  const Dims d = match("attention", {{"q", q, "B T D"}, {"k", k, "B U D"}, {"v", v, "B U E"}});
  const float by = scale > 0 ? scale : 1.f / std::sqrt(static_cast<float>(d["D"]));
  const AttentionSizes sizes{d["B"], d["T"], d["U"], d["D"], d["E"], by};
  const bool fits = std::max(sizes.D, sizes.E) <= kWidest && k.numel() > 0 && v.numel() > 0;
  if (!is_cpu_class() || !fits || reference_variants()) return attention_composed({q, k, v}, by);
  return make(std::make_shared<Attention>(sizes), {sizes.B, sizes.T, sizes.E}, {q, k, v});
}

}  // namespace cloam
