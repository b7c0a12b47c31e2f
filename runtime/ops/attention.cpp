// Attention (Vaswani et al. 2017, equation 1): a kernel that keeps no matrix of scores, and the composition that it
// stands for.
#include <algorithm>
#include <cmath>

#include "runtime/cl.h"
#include "runtime/ops.h"
#include "runtime/ops/ceil_div.h"
#include "runtime/ops/composed.h"

namespace cloam {
namespace {

const Registered kAttentionKernels("attention");

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
constexpr size_t kScratch = 640 << 10;  // local memory that the blocks of the widest heads take

/// The size class of the widths, for the kernels of the result or of the gradient.
const char* size_class(const AttentionSizes& s, bool gradient) {
  const int64_t width = std::max(s.D, s.E);
  if (width <= 64) return gradient ? "narrow_grad" : "narrow";
  if (width <= 128) return gradient ? "medium_grad" : "medium";
  return gradient ? "wide_grad" : "wide";
}

cl::Kernel& kernel_for(const Variant& v, const AttentionSizes& s) {
  return kernel(v, {{"D", static_cast<int>(s.D)}, {"E", static_cast<int>(s.E)}});
}

/// GPU devices: a group of lanes for each `tile` of `length` rows, each batch and each chunk of `width` columns.
Range group_range(const Variant& v, const AttentionSizes& s, int64_t length, int64_t width) {
  Range range = range1(ceil_div(length, v["TILE"]) * v["LANES"], v["LANES"]);
  range.global[1] = static_cast<size_t>(s.B);
  range.global[2] = static_cast<size_t>(ceil_div(width, v["CHUNK"]));
  return range;
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
  const Variant& v = choose("attention", size_class(s, false));
  logs = empty({s.B, s.T});
  Range range = is_cpu_class() ? range2(ceil_div(s.T, v["BQ"]), s.B) : group_range(v, s, s.T, s.E);
  range.flops = s.pair_flops(1, 1);
  launch(kernel_for(v, s), "attention", range, in[0], in[1], in[2], out, logs, s.T, s.U, s.scale);
}

/// CPU devices: parts of the keys, `each` blocks a part, with a sum of dq for each part: enough of them for the cores,
/// by the sizes alone. GPU devices sum dq in one piece.
struct KeyParts {
  int64_t count = 1, each = 0;
};
KeyParts key_parts(const AttentionSizes& s) {
  if (!is_cpu_class()) return {};
  const int64_t blocks = ceil_div(s.U, choose("attention", size_class(s, true))["BK"]);
  const int64_t each = ceil_div(blocks, std::clamp<int64_t>(16 / s.B, 1, blocks));
  return {ceil_div(blocks, each), each};
}

/// Inputs q, k, v, g and the sums of g * result over its rows -> packed [parts, q's shape], gradients of k and of v.
struct AttentionGrad final : Op {
  AttentionGrad(std::shared_ptr<const Attention> op, const KeyParts& cut) : forward(std::move(op)), parts(cut) {}
  const char* name() const override { return "attention_grad"; }
  void run(const Tensors& in, Tensor& out) const override;
  void run_groups(const Tensors& in, const Tensor& out) const;
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override;
  std::shared_ptr<const Attention> forward;
  KeyParts parts;
};

void AttentionGrad::run(const Tensors& in, Tensor& out) const {
  if (!is_cpu_class()) return run_groups(in, out);
  const AttentionSizes& s = forward->sizes;
  Range range = range2(parts.count, s.B);
  range.flops = s.pair_flops(3, 2);
  launch(kernel_for(choose("attention", size_class(s, true)), s), "attention_grad", range, in[0], in[1], in[2], in[3],
         forward->logs, in[4], out, s.T, s.U, s.scale, parts.each);
}

void AttentionGrad::run_groups(const Tensors& in, const Tensor& out) const {
  const AttentionSizes& s = forward->sizes;
  const auto part = [&](const Variant& v, Range range) {
    range.flops = s.pair_flops(2, 1);
    launch(kernel_for(v, s), v.kernel.c_str(), range, in[0], in[1], in[2], in[3], forward->logs, in[4], out, s.T, s.U,
           s.scale);
  };
  const Variant &queries = choose("attention", "queries_grad"), &keys = choose("attention", "keys_grad");
  part(queries, group_range(queries, s, s.T, s.D));
  part(keys, group_range(keys, s, s.U, std::max(s.D, s.E)));
}

// delta is a function of the other inputs: its own gradient is left out, and counted in theirs.
Tensors AttentionGrad::vjp(const Tensors& in, const Tensor&, const Tensor& g) const {
  const auto composed = [scale = forward->sizes.scale, empty_parts = parts.count - 1](const Tensors& of) {
    const auto plain = [scale](const Tensors& x) { return attention_composed(x, scale); };
    Tensors all = vjp_of(plain, {of[0], of[1], of[2]}, of[3]);
    // Whoever adds the parts up takes them all the same: the first one stands for the sum.
    if (empty_parts > 0) all.insert(all.begin() + 1, zeros({empty_parts * of[0].numel()}));
    return packed(all);
  };
  Tensors gradients = vjp_of(composed, {in[0], in[1], in[2], in[3]}, g);
  gradients.emplace_back();
  return gradients;
}

Tensors Attention::vjp(const Tensors& in, const Tensor& out, const Tensor& g) const {
  const AttentionSizes& s = sizes;
  const KeyParts parts = key_parts(s);
  const Tensor delta = stop_gradient(sum(g * out, {{-1}}));
  const Tensor all =
      make(std::make_shared<AttentionGrad>(std::static_pointer_cast<const Attention>(shared()), parts),
           {parts.count * in[0].numel() + in[1].numel() + in[2].numel()}, {in[0], in[1], in[2], g, delta});
  Tensors gradients = unpacked(all, {{parts.count, s.B, s.T, s.D}, {s.B, s.U, s.D}, {s.B, s.U, s.E}});
  gradients[0] = parts.count == 1 ? reshape(gradients[0], {s.B, s.T, s.D}) : sum(gradients[0], {{0}});
  return gradients;
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
  const bool scratch = !is_cpu_class() || device().local_bytes >= kScratch;
  const bool fits = scratch && std::max(sizes.D, sizes.E) <= kWidest && q.numel() > 0 && k.numel() > 0 && v.numel() > 0;
  if (!fits || runs_reference("attention")) return attention_composed({q, k, v}, by);
  return make(std::make_shared<Attention>(sizes), {sizes.B, sizes.T, sizes.E}, {q, k, v});
}

}  // namespace cloam
