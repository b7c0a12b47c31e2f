// A small multilayer perceptron as one op. Composition (its reference): matmul, relu.
#include <algorithm>

#include "runtime/cl.h"
#include "runtime/ops/composed.h"
#include "runtime/ops/fields.h"

namespace cloam {
namespace {

const Registered kMlpKernels("mlp");

struct Sizes {
  int64_t in, width, hidden, out;
  int64_t weights() const { return in * width + (hidden - 1) * width * width + width * out; }
  int64_t padded() const {  // of mlp_pack
    const auto whole_vectors = [](int64_t columns) { return (columns + 15) / 16 * 16; };
    return width * (out + (hidden - 1) * width + whole_vectors(in) + whole_vectors(out));
  }
  /// The weights end to end -> those of each layer.
  Tensors split(const Tensor& all) const {
    std::vector<Shape> shapes(static_cast<size_t>(hidden) + 1, {width, width});
    shapes.front()[0] = in;
    shapes.back()[1] = out;
    return unpacked(all, shapes);
  }
  Constants constants() const {
    return {{"IN", static_cast<int>(in)},
            {"WIDTH", static_cast<int>(width)},
            {"HIDDEN", static_cast<int>(hidden)},
            {"OUT", static_cast<int>(out)}};
  }
};

/// Samples a work-item takes so that about `items` share n: whole tiles, a few blocks if there are as many.
int64_t per_item(int64_t n, int64_t items) { return std::max<int64_t>(64, (n + 64 * items - 1) / (64 * items) * 64); }

/// What the gradient needs beside inputs: the hidden layers [hidden, n, width] and the transposed weights.
struct Saved {
  Tensor hidden, packed;
};

cl::Kernel& part(const Variant& v, const char* name, const Sizes& sizes) { return kernel(v, name, sizes.constants()); }

struct MlpForward final : Op {
  explicit MlpForward(const Sizes& s) : sizes(s) {}
  const char* name() const override { return "mlp"; }
  void run(const Tensors& in, Tensor& out) const override { saved = forward(in, out, out.tracked()); }
  Saved forward(const Tensors& in, const Tensor& out, bool keep) const;
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override;
  Sizes sizes;
  mutable Saved saved;  // for the gradient, which takes it; computed again if it comes twice
};

Saved forward_on_cpu(const Variant& v, const Sizes& sizes, const Tensors& in, const Tensor& out, bool keep) {
  const int64_t n = in[0].dim(0), share = per_item(n, 128), items = (n + share - 1) / share;
  const Tensor packed = empty({sizes.padded()});
  const Tensor hidden = empty(keep ? Shape{sizes.hidden, n, sizes.width} : Shape{items, 2 * v["BLOCK"], sizes.width});
  if (keep || sizes.out % 16 != 0)
    launch(part(v, "mlp_pack", sizes), "mlp_pack", range1(keep ? sizes.hidden + 2 : 2), in[1], packed);
  Range range = range1(items);
  range.flops = 2.0 * static_cast<double>(n * sizes.weights());
  launch(part(v, "mlp_forward", sizes), "mlp_forward", range, in[0], in[1], packed, out, hidden, n, share,
         keep ? 1 : 0);
  return {hidden, packed};
}

Saved forward_on_gpu(const Variant& v, const Sizes& sizes, const Tensors& in, const Tensor& out, bool keep) {
  const int64_t n = in[0].dim(0), groups = (n + v["TILE"] - 1) / v["TILE"];
  const Tensor hidden = empty({sizes.hidden, keep ? n : 1, sizes.width});
  Range range = range1(64 * groups, 64);
  range.flops = 2.0 * static_cast<double>(n * sizes.weights());
  launch(part(v, "mlp_forward", sizes), "mlp_forward", range, in[0], in[1], out, hidden, n, keep ? 1 : 0);
  return {hidden, {}};
}

Saved MlpForward::forward(const Tensors& in, const Tensor& out, bool keep) const {
  const Variant& v = choose("mlp");
  const Saved all = (v.where == "cpu" ? forward_on_cpu : forward_on_gpu)(v, sizes, in, out, keep);
  return keep ? all : Saved{};
}

/// in: x, the packed weights, dy, y; result: dx [n * in] followed by the packed weight gradient. y is there so that its
/// evaluation, which saves the hidden layers, comes first.
struct MlpBackward final : Op {
  explicit MlpBackward(std::shared_ptr<const MlpForward> op) : forward(std::move(op)) {}
  const char* name() const override { return "mlp_grad"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    const auto both = [sizes = forward->sizes](const Tensors& of) {
      return packed(
          vjp_of([&](const Tensors& x) { return mlp_composed(x[0], sizes.split(x[1])); }, {of[0], of[1]}, of[2]));
    };
    return vjp_of(both, in, g);
  }
  std::shared_ptr<const MlpForward> forward;
};

void backward_on_cpu(const Sizes& sizes, const Saved& saved, const Tensors& in, const Tensor& out) {
  const Variant& v = choose("mlp");
  // Each item carries a copy of the weight gradient, and their number fixes the order of summation.
  const int64_t n = in[0].dim(0), share = per_item(n, 32), items = (n + share - 1) / share;
  const Tensor partial = empty({items, sizes.weights()}), gradients = empty({items, 2 * v["BLOCK"], sizes.width});
  Range range = range1(items);
  range.flops = 4.0 * static_cast<double>(n * sizes.weights());
  launch(part(v, "mlp_backward", sizes), "mlp_backward", range, in[0], saved.packed, saved.hidden, in[2], out, partial,
         gradients, n, share);
  launch(part(v, "mlp_reduce", sizes), "mlp_reduce", range1(sizes.weights() / sizes.width), partial, out, n * sizes.in,
         items);
}

/// The kernel takes the gradient through the layers; the weights' are products with what came into each.
void backward_on_gpu(const Sizes& sizes, const Saved& saved, const Tensors& in, Tensor& out) {
  const Variant& v = choose("mlp");
  const int64_t n = in[0].dim(0), groups = (n + v["TILE"] - 1) / v["TILE"];
  const Tensor dx = empty({n, sizes.in}), dz = empty({sizes.hidden, n, sizes.width});
  Range range = range1(64 * groups, 64);
  range.flops = 2.0 * static_cast<double>(n * sizes.weights());
  launch(part(v, "mlp_backward", sizes), "mlp_backward", range, in[1], saved.hidden, in[2], dx, dz, n);
  const auto layer = [&](const Tensor& of, int64_t i) { return reshape(slice(of, 0, i, i + 1), {n, sizes.width}); };
  Tensors parts{reshape(dx, {n * sizes.in})};
  for (int64_t i = 0; i <= sizes.hidden; i++) {
    const Tensor into = i == 0 ? in[0] : layer(saved.hidden, i - 1), of = i < sizes.hidden ? layer(dz, i) : in[2];
    parts.push_back(reshape(matmul(transpose(into), of), {into.dim(1) * of.dim(1)}));
  }
  const Tensor all = concat(parts, 0);
  adopt(out, all);
}

void MlpBackward::run(const Tensors& in, Tensor& out) const {
  Saved saved = std::move(forward->saved);
  forward->saved = {};
  if (!saved.hidden) saved = forward->forward(in, empty({in[0].dim(0), forward->sizes.out}), true);
  if (choose("mlp").where == "cpu")
    backward_on_cpu(forward->sizes, saved, in, out);
  else
    backward_on_gpu(forward->sizes, saved, in, out);
}

Tensors MlpForward::vjp(const Tensors& in, const Tensor& out, const Tensor& g) const {
  const int64_t n = in[0].dim(0);
  // The gradient keeps this very op alive, and with it the activations of this very evaluation.
  auto self = std::static_pointer_cast<const MlpForward>(shared());
  const Shape packed{n * sizes.in + sizes.weights()};
  const Tensor both = make(std::make_shared<MlpBackward>(self), packed, {in[0], in[1], g, out});
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
  if (!fits || choose("mlp").where == "reference") return mlp_composed(x, weights);
  Tensors flat;
  for (const Tensor& w : weights) flat.push_back(reshape(w, {w.numel()}));
  return make(std::make_shared<MlpForward>(sizes), {x.dim(0), sizes.out}, {x, concat(flat, 0)});
}

}  // namespace cloam
