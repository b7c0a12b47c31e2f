// A small multilayer perceptron as one op. Composition (reference, and the path of GPU-class devices): matmul, relu.
#include <algorithm>

#include "runtime/cl.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

const Registered kRegistered("mlp");

struct Sizes {
  int64_t in, width, hidden, out;
  int64_t weights() const { return in * width + (hidden - 1) * width * width + width * out; }
  Constants constants() const {
    return {{"IN", static_cast<int>(in)},
            {"WIDTH", static_cast<int>(width)},
            {"HIDDEN", static_cast<int>(hidden)},
            {"OUT", static_cast<int>(out)}};
  }
};

constexpr int64_t kBlock = 64;
int64_t padded(int64_t n) { return (n + kBlock - 1) / kBlock * kBlock; }

/// Samples a work-item takes, in whole blocks, so that `items` share n. Backward keeps to 16: each carries a copy of
/// the weight gradient, and their number fixes the order of summation.
int64_t share(int64_t n, int64_t items) { return std::max<int64_t>(kBlock, padded((n + items - 1) / items)); }

struct MlpForward final : Op {
  explicit MlpForward(const Sizes& s) : sizes(s) {}
  const char* name() const override { return "mlp"; }
  void run(const Tensors& in, Tensor& out) const override { hidden = forward(in, out, out.tracked()); }
  Tensor forward(const Tensors& in, const Tensor& out, bool keep) const;
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override;
  Sizes sizes;
  mutable Tensor hidden;  // activations saved for the gradient, which takes them; computed again if it comes twice
};

Tensor MlpForward::forward(const Tensors& in, const Tensor& out, bool keep) const {
  const int64_t n = in[0].dim(0), rows = padded(n), per_item = share(n, 64);
  const Tensor saved = empty({sizes.hidden, keep ? rows : 1, sizes.width});
  Range range = range1((rows + per_item - 1) / per_item);
  range.flops = 2.0 * static_cast<double>(n * sizes.weights());
  launch(kernel("mlp", "mlp_forward", sizes.constants()), "mlp_forward", range, in[0], in[1], out, saved, n, rows,
         per_item, keep ? 1 : 0);
  return keep ? saved : Tensor();
}

/// Result: dx [n * in] followed by the packed weight gradient.
struct MlpBackward final : Op {
  explicit MlpBackward(std::shared_ptr<const MlpForward> op) : forward(std::move(op)) {}
  const char* name() const override { return "mlp_grad"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override {
    no_gradient("mlp", "the fused op is once differentiable; use mlp_composed where second derivatives are needed");
  }
  std::shared_ptr<const MlpForward> forward;
};

void MlpBackward::run(const Tensors& in, Tensor& out) const {
  const Sizes& sizes = forward->sizes;
  const int64_t n = in[0].dim(0), rows = padded(n), per_item = share(n, 16), items = (rows + per_item - 1) / per_item;
  Tensor hidden = std::move(forward->hidden);
  forward->hidden = {};
  if (!hidden) hidden = forward->forward(in, empty({n, sizes.out}), true);
  const Tensor partial = empty({items, sizes.weights()});
  Range range = range1(items);
  range.flops = 4.0 * static_cast<double>(n * sizes.weights());
  launch(kernel("mlp", "mlp_backward", sizes.constants()), "mlp_backward", range, in[0], in[1], hidden, in[2], out,
         partial, n, rows, per_item);
  launch(kernel("mlp", "mlp_reduce", sizes.constants()), "mlp_reduce", range1((sizes.weights() + 1023) / 1024), partial,
         out, n * sizes.in, sizes.weights(), items, 1024);
}

Tensors MlpForward::vjp(const Tensors& in, const Tensor&, const Tensor& g) const {
  const int64_t n = in[0].dim(0);
  // The gradient keeps this very op alive, and with it the activations of this very evaluation.
  auto self = std::static_pointer_cast<const MlpForward>(shared());
  const Tensor both = make(std::make_shared<MlpBackward>(self), {n * sizes.in + sizes.weights()}, {in[0], in[1], g});
  return {reshape(slice(both, 0, 0, n * sizes.in), {n, sizes.in}), slice(both, 0, n * sizes.in, both.dim(0))};
}

Sizes check(const Tensor& x, const Tensors& weights) {
  if (weights.size() < 2)
    throw Error(Fault::internal, text("[mlp] ", weights.size(),
                                      " weights given, want one of a hidden layer and one of the output at least"));
  match("mlp", {{"x", x, "S I"}, {"weights[0]", weights[0], "I W"}});
  const int64_t width = weights[0].dim(1);
  for (size_t i = 1; i < weights.size(); i++)
    if (weights[i].rank() != 2 || weights[i].dim(0) != width || (i + 1 < weights.size() && weights[i].dim(1) != width))
      throw Error(Fault::internal, text("[mlp] weights[", i, "] has shape ", to_string(weights[i].shape()), ", want [",
                                        width, i + 1 < weights.size() ? text(",", width, "]") : ",O]"));
  return {x.dim(1), width, static_cast<int64_t>(weights.size()) - 1, weights.back().dim(1)};
}

}  // namespace

Tensor mlp_composed(const Tensor& x, const Tensors& weights) {
  check(x, weights);
  Tensor h = x;
  for (size_t i = 0; i + 1 < weights.size(); i++) h = relu(matmul(h, weights[i]));
  return matmul(h, weights.back());
}

Tensor mlp(const Tensor& x, const Tensors& weights) {
  const Sizes sizes = check(x, weights);
  const bool fits = sizes.width % 16 == 0 && sizes.width <= 128 && sizes.in <= 128 && sizes.out <= 128;
  if (!is_cpu_class() || !fits || reference_variants()) return mlp_composed(x, weights);
  Tensors flat;
  for (const Tensor& w : weights) flat.push_back(reshape(w, {w.numel()}));
  return make(std::make_shared<MlpForward>(sizes), {x.dim(0), sizes.out}, {x, concat(flat, 0)});
}

}  // namespace cloam
