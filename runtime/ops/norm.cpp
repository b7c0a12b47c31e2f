// Softmax and normalisations: fused kernels for rows that lie together, and the compositions that they stand for.
#include <algorithm>

#include "runtime/cl.h"
#include "runtime/ops.h"
#include "runtime/ops/composed.h"

namespace cloam {
namespace {

const Registered kNormKernels[] = {Registered("group_norm"), Registered("layer_norm"), Registered("softmax"),
                                   Registered("log_softmax")};

/// x less its largest value along the axis: no exponential of it overflows, and the softmax is the same.
Tensor below_largest(const Tensor& x, int axis) { return x - stop_gradient(max(x, {{axis}, true})); }

/// Mean 0 and variance 1 along the last axis.
Tensor standardised(const Tensor& x, float epsilon) {
  const Tensor centred = x - mean(x, {{-1}, true});
  return centred * rsqrt(mean(square(centred), {{-1}, true}) + epsilon);
}

bool fused(const Tensor& x) { return !runs_reference("norm") && x.dtype() == DType::f32 && x.numel() > 0; }

/// Rows shared out: a work-item on CPU devices, a group of lanes on GPU devices takes `chunk` of them.
struct RowShare {
  int64_t chunk, parts;
  Range range(const Variant& v) const {
    return is_cpu_class() ? range1(parts) : range1(parts * v["LANES"], v["LANES"]);
  }
};
/// `most`: parts on GPU devices.
RowShare share_rows(int64_t rows, int64_t most) {
  const int64_t parts = is_cpu_class() ? 64 : most, chunk = std::max<int64_t>(1, (rows + parts - 1) / parts);
  return {chunk, (rows + chunk - 1) / chunk};
}
RowShare share_rows(int64_t rows) { return share_rows(rows, rows); }

// ---- Group normalisation of x [N,C,...] with a scale and a shift of each channel, [C] or [N,C].

struct GroupSizes {
  int64_t images, groups, channels, pixels;  // channels of one group
  float epsilon;
  bool silu;
  int64_t rows() const { return images * groups; }
  int64_t image_pitch(const Tensor& scale) const { return scale.rank() == 2 ? groups * channels : 0; }
  Constants constants() const { return {{"SILU", silu}, {"LOG", 0}}; }
};

/// The inputs are x, scale and shift.
Tensor group_norm_composed(const Tensors& in, const GroupSizes& s) {
  const Tensor& x = in[0];
  const Tensor grouped = reshape(x, {s.images, s.groups, s.channels * s.pixels});
  const Tensor standard = reshape(standardised(grouped, s.epsilon), x.shape());
  const auto of_channels = [&](const Tensor& t) {
    Shape shape = Shape::filled(x.rank(), 1);
    if (t.rank() == 2) shape[0] = t.dim(0);
    shape[1] = t.dim(-1);
    return reshape(t, shape);
  };
  const Tensor y = standard * of_channels(in[1]) + of_channels(in[2]);
  return s.silu ? silu(y) : y;
}

struct GroupNorm final : Op {
  explicit GroupNorm(const GroupSizes& s) : sizes(s) {}
  const char* name() const override { return "group_norm"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override;
  GroupSizes sizes;
  mutable Tensor stats;  // [rows, 2]: mean and 1 / deviation, for the gradient
};

void GroupNorm::run(const Tensors& in, Tensor& out) const {
  const GroupSizes& s = sizes;
  stats = empty({s.rows(), 2});
  const Variant& v = choose("norm", "group_norm");
  const RowShare share = share_rows(s.rows());
  launch(kernel(v, s.constants()), "group_norm", share.range(v), in[0], in[1], in[2], out, stats, s.rows(), s.groups,
         s.channels, s.pixels, s.image_pitch(in[1]), s.epsilon, share.chunk);
}

/// Inputs x, scale, shift, g -> packed gradients of x, of scale [N,C] and of shift [N,C].
struct GroupNormGrad final : Op {
  explicit GroupNormGrad(std::shared_ptr<const GroupNorm> op) : forward(std::move(op)) {}
  const char* name() const override { return "group_norm_grad"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return vjp_of(
        [s = forward->sizes](const Tensors& of) {
          const auto composed = [&](const Tensors& x) { return group_norm_composed(x, s); };
          const auto each = [&](const Tensor& t) { return broadcast_to(t, {s.images, s.groups * s.channels}); };
          return packed(vjp_of(composed, {of[0], each(of[1]), each(of[2])}, of[3]));
        },
        in, g);
  }
  std::shared_ptr<const GroupNorm> forward;
};

void GroupNormGrad::run(const Tensors& in, Tensor& out) const {
  const GroupSizes& s = forward->sizes;
  if (!forward->stats) {  // the result itself was never asked for
    Tensor unused = empty(in[0].shape());
    forward->run(in, unused);
  }
  const Variant& v = choose("norm", "group_norm_grad");
  const RowShare share = share_rows(s.rows());
  launch(kernel(v, s.constants()), "group_norm_grad", share.range(v), in[0], in[1], in[2], forward->stats, in[3], out,
         s.rows(), s.groups, s.channels, s.pixels, s.image_pitch(in[1]), share.chunk);
}

Tensors GroupNorm::vjp(const Tensors& in, const Tensor&, const Tensor& g) const {
  const Shape coefficients = {sizes.images, sizes.groups * sizes.channels};
  const Tensor all = make(std::make_shared<GroupNormGrad>(std::static_pointer_cast<const GroupNorm>(shared())),
                          {in[0].numel() + 2 * numel(coefficients)}, {in[0], in[1], in[2], g});
  return unpacked(all, {in[0].shape(), coefficients, coefficients});
}

GroupSizes check(const Tensor& x, int groups, const Tensor& gamma, const Tensor& beta, const GroupNormOptions& with) {
  const int64_t channels = x.rank() >= 2 ? x.dim(1) : 0;
  const auto fits = [&](const Tensor& t, const Shape& shape) { return !t || t.shape() == shape; };
  const bool norm = x.rank() >= 2 && groups >= 1 && channels % groups == 0;
  if (!norm || !fits(gamma, {channels}) || !fits(beta, {channels}))
    throw Error(Fault::internal,
                text("[group_norm] x ", to_string(x.shape()), ", gamma ", gamma ? to_string(gamma.shape()) : "none",
                     ", beta ", beta ? to_string(beta.shape()) : "none", ", ", groups,
                     " groups: want x [N, C, ...], gamma and beta [C], C a multiple of groups"));
  if (!fits(with.scale, {x.dim(0), channels}) || !fits(with.shift, {x.dim(0), channels}))
    throw Error(Fault::internal, text("[group_norm] scale ", with.scale ? to_string(with.scale.shape()) : "none",
                                      ", shift ", with.shift ? to_string(with.shift.shape()) : "none", " for x ",
                                      to_string(x.shape()), ": want [N, C]"));
  const int64_t rows = std::max<int64_t>(1, x.dim(0) * channels);
  return {x.dim(0), groups, channels / groups, x.numel() / rows, with.epsilon, with.silu};
}

// ---- Layer normalisation: the rows of x [..., C].

const Constants kPlain = {{"SILU", 0}, {"LOG", 0}};

Tensor layer_norm_composed(const Tensors& in, float epsilon) { return standardised(in[0], epsilon) * in[1] + in[2]; }

struct LayerNorm final : Op {
  explicit LayerNorm(float e) : epsilon(e) {}
  const char* name() const override { return "layer_norm"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override;
  float epsilon;
  mutable Tensor stats;  // as GroupNorm's
};

void LayerNorm::run(const Tensors& in, Tensor& out) const {
  const int64_t n = in[1].dim(0), rows = in[0].numel() / n;
  stats = empty({rows, 2});
  const Variant& v = choose("norm", "layer_norm");
  const RowShare share = share_rows(rows);
  launch(kernel(v, kPlain), "layer_norm", share.range(v), in[0], in[1], in[2], out, stats, rows, n, epsilon,
         share.chunk);
}

/// Each part of the rows has its own sums of the gradients of gamma and beta.
RowShare share_sums(int64_t rows) { return share_rows(rows, 512); }

/// Inputs x, gamma, beta, g -> packed gradients of x, of gamma [parts,C] and of beta [parts,C].
struct LayerNormGrad final : Op {
  explicit LayerNormGrad(std::shared_ptr<const LayerNorm> op) : forward(std::move(op)) {}
  const char* name() const override { return "layer_norm_grad"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override;
  std::shared_ptr<const LayerNorm> forward;
};

void LayerNormGrad::run(const Tensors& in, Tensor& out) const {
  const int64_t n = in[1].dim(0), rows = in[0].numel() / n;
  if (!forward->stats) {
    Tensor unused = empty(in[0].shape());
    forward->run(in, unused);
  }
  const Variant& v = choose("norm", "layer_norm_grad");
  const RowShare share = share_sums(rows);
  launch(kernel(v, kPlain), "layer_norm_grad", share.range(v), in[0], in[1], forward->stats, in[3], out, rows, n,
         share.chunk);
}

Tensors LayerNormGrad::vjp(const Tensors& in, const Tensor&, const Tensor& g) const {
  const int64_t n = in[1].dim(0), parts = share_sums(in[0].numel() / n).parts;
  const auto composed = [epsilon = forward->epsilon, n, parts](const Tensors& of) {
    const auto plain = [epsilon](const Tensors& x) { return layer_norm_composed(x, epsilon); };
    Tensors all = vjp_of(plain, {of[0], of[1], of[2]}, of[3]);
    // Whoever adds the parts up takes them all the same: the first one stands for the sum.
    for (size_t i : {1, 2}) all[i] = pad(reshape(sum_to(all[i], {n}), {1, n}), 0, 0, parts - 1);
    return packed(all);
  };
  return vjp_of(composed, in, g);
}

Tensors LayerNorm::vjp(const Tensors& in, const Tensor&, const Tensor& g) const {
  const int64_t n = in[1].dim(0), parts = share_sums(in[0].numel() / n).parts;
  const Tensor all = make(std::make_shared<LayerNormGrad>(std::static_pointer_cast<const LayerNorm>(shared())),
                          {in[0].numel() + 2 * parts * n}, {in[0], in[1], in[2], g});
  const Tensors each = unpacked(all, {in[0].shape(), {parts, n}, {parts, n}});
  return {each[0], sum(each[1], {{0}}), sum(each[2], {{0}})};
}

// ---- Softmax along the last axis, and its logarithm.

struct Softmax final : Op {
  explicit Softmax(bool of_it) : logarithm(of_it) {}
  const char* name() const override { return logarithm ? "log_softmax" : "softmax"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override;
  Constants constants() const { return {{"SILU", 0}, {"LOG", logarithm}}; }
  bool logarithm;  // of the softmax
};

void Softmax::run(const Tensors& in, Tensor& out) const {
  const int64_t n = out.dim(-1), rows = out.numel() / n;
  const Variant& v = choose("norm", "softmax");
  const RowShare share = share_rows(rows);
  launch(kernel(v, constants()), name(), share.range(v), in[0], out, rows, n, share.chunk);
}

/// Inputs: the result y of the softmax and g. dx = y (g - sum(y g)), of logarithms dx = g - exp(y) sum(g).
struct SoftmaxGrad final : Op {
  explicit SoftmaxGrad(std::shared_ptr<const Softmax> op) : forward(std::move(op)) {}
  const char* name() const override { return forward->logarithm ? "log_softmax_grad" : "softmax_grad"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    const auto composed = [logarithm = forward->logarithm](const Tensors& of) {
      const Tensor &y = of[0], &given = of[1];
      if (logarithm) return given - exp(y) * sum(given, {{-1}, true});
      return y * (given - sum(y * given, {{-1}, true}));
    };
    return vjp_of(composed, in, g);
  }
  std::shared_ptr<const Softmax> forward;
};

void SoftmaxGrad::run(const Tensors& in, Tensor& out) const {
  const int64_t n = out.dim(-1), rows = out.numel() / n;
  const Variant& v = choose("norm", "softmax_grad");
  const RowShare share = share_rows(rows);
  launch(kernel(v, forward->constants()), name(), share.range(v), in[0], in[1], out, rows, n, share.chunk);
}

Tensors Softmax::vjp(const Tensors&, const Tensor& out, const Tensor& g) const {
  return {
      make(std::make_shared<SoftmaxGrad>(std::static_pointer_cast<const Softmax>(shared())), out.shape(), {out, g})};
}

bool fused_softmax(const Tensor& x, int axis) { return axis == x.rank() - 1 && fused(x); }

}  // namespace

Tensor softmax(const Tensor& x, int axis) {
  const int on = axis_of("softmax", x.rank(), axis);
  if (fused_softmax(x, on)) return make(std::make_shared<Softmax>(false), x.shape(), {x});
  const Tensor e = exp(below_largest(x, on));
  return e / sum(e, {{on}, true});
}

Tensor log_softmax(const Tensor& x, int axis) {
  const int on = axis_of("log_softmax", x.rank(), axis);
  if (fused_softmax(x, on)) return make(std::make_shared<Softmax>(true), x.shape(), {x});
  const Tensor shifted = below_largest(x, on);
  return shifted - log(sum(exp(shifted), {{on}, true}));
}

Tensor layer_norm(const Tensor& x, const Tensor& gamma, const Tensor& beta, float epsilon) {
  if (x.rank() == 0) throw Error(Fault::internal, "[layer_norm] x has no axis, want [..., C]");
  const Dims d = match("layer_norm", {{"gamma", gamma, "C"}, {"beta", beta, "C"}});
  if (d["C"] != x.dim(-1))
    throw Error(Fault::internal, text("[layer_norm] gamma has shape ", to_string(gamma.shape()), " for x ",
                                      to_string(x.shape()), ", want [", x.dim(-1), "]"));
  if (!fused(x)) return layer_norm_composed({x, gamma, beta}, epsilon);
  return make(std::make_shared<LayerNorm>(epsilon), x.shape(), {x, gamma, beta});
}

Tensor group_norm(const Tensor& x, int groups, const Tensor& gamma, const Tensor& beta, const GroupNormOptions& with) {
  const GroupSizes sizes = check(x, groups, gamma, beta, with);
  Tensor scale = gamma ? gamma : ones({x.dim(1)}), shift = beta ? beta : zeros({x.dim(1)});
  if (with.scale) {
    const Tensor by = with.scale + 1.f;
    scale = scale * by;
    shift = shift * by;
  }
  if (with.shift) shift = shift + with.shift;
  // Both [C], or both [N,C].
  if (scale.rank() != shift.rank()) scale = broadcast_to(scale, shift.shape());
  if (!fused(x)) return group_norm_composed({x, scale, shift}, sizes);
  return make(std::make_shared<GroupNorm>(sizes), x.shape(), {x, scale, shift});
}

}  // namespace cloam
