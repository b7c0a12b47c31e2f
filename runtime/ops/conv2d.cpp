// Convolution over images and its two adjoints: each is linear in both operands, so the three are closed under
// gradients.
#include "runtime/ops/conv2d.h"

#include "runtime/ops/epilogue.h"
#include "runtime/variant.h"

namespace cloam {
namespace {

const Registered kConv2dKernels[] = {Registered("conv2d"), Registered("conv2d_dx"), Registered("conv2d_dw")};

enum class Part { forward, dx, dw };

struct Conv2d final : Op {
  Conv2d(Part which, const ConvSizes& s, int epilogue = 0) : part(which), sizes(s), flags(epilogue) {}
  const char* name() const override {
    return part == Part::forward ? "conv2d" : part == Part::dx ? "conv2d_dx" : "conv2d_dw";
  }
  uint64_t key() const override { return static_cast<uint64_t>(flags); }
  void run(const Tensors& in, Tensor& out) const override;
  bool is_reference() const;
  bool run_tiled(const Tensors& in, const Tensor& out) const;
  void run_reference(const Tensors& in, const Tensor& out) const;
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override;
  Tensor make_part(Part which, const Tensor& a, const Tensor& b) const;
  Part part;
  ConvSizes sizes;
  int flags;  // of the epilogue, forward only: bias and residual follow x and w
};

/// float16 as float32, in scratch.
Tensor widened(const Tensor& x) {
  const Tensor wide = empty(x.shape());
  const Chunks walk = chunks(x.numel(), 1 << 14);
  if (x.numel() > 0) launch(kernel("conv2d", "widen"), "conv2d_widen", walk.range, x, wide, x.numel(), walk.chunk);
  return wide;
}

// Kernels for GPUs read an image of halves as it lies. On a CPU, whose kernels pack their inputs anyway, it is widened
// first: the same sums either way.
void Conv2d::run(const Tensors& in, Tensor& out) const {
  Tensors of = in;
  if (of[0].dtype() == DType::f16 && (is_cpu_class() || sizes.empty() || is_reference())) of[0] = widened(of[0]);
  if (sizes.empty() || is_reference() || !run_tiled(of, out)) run_reference(of, out);
}

bool Conv2d::is_reference() const {
  return runs_reference("conv2d") || (part == Part::dw && runs_reference("conv2d_dw"));
}

bool Conv2d::run_tiled(const Tensors& in, const Tensor& out) const {
  if (is_cpu_class()) {
    if (part == Part::dw) return run_conv2d_dw_cpu(sizes, in, out);
    return run_conv2d_cpu(sizes, part == Part::forward ? forward_pass(sizes) : backward_pass(sizes), flags, in, out);
  }
  if (part == Part::forward) run_conv2d_gpu(sizes, flags, in, out);
  if (part == Part::dx) run_conv2d_dx_gpu(sizes, in, out);
  if (part == Part::dw) run_conv2d_dw_gpu(sizes, in, out);
  return true;
}

void Conv2d::run_reference(const Tensors& in, const Tensor& out) const {
  const ConvSizes& z = sizes;
  const bool dw = part == Part::dw;
  Range range = elements(dw ? z.channels() * z.R * z.S : out.dim(2) * out.dim(3));
  range.global[1] = static_cast<size_t>(dw ? z.K : out.dim(0) * out.dim(1));
  range.flops = z.flops();
  cl::Kernel& k = kernel(dw ? "conv2d_dw" : "conv2d", name());
  Arguments arguments(k);
  for (const Tensor& t : {in[0], in[1], out}) arguments.add(t);
  if (dw) arguments.add(z.N);
  for (int64_t size : {z.C, z.H, z.W, z.K, z.R, z.S, z.P, z.Q}) arguments.add(size);
  for (int value : {z.with.stride, z.with.pad, z.with.groups}) arguments.add(value);
  enqueue(k, name(), range, arguments.bytes());
  if (!flags) return;
  range.flops = 0;
  const Tensor &bias = flags & kBias ? in[2] : in[1], &residual = flags & kResidual ? in.back() : in[1];
  launch(kernel("conv2d", "conv2d_end"), "conv2d_end", range, out, bias, residual, z.K, z.P * z.Q,
         bias.rank() == 2 ? z.K : 0, flags);
}

Tensor Conv2d::make_part(Part which, const Tensor& a, const Tensor& b) const {
  const ConvSizes& z = sizes;
  const Shape shape = which == Part::forward ? Shape{z.N, z.K, z.P, z.Q}
                      : which == Part::dx    ? Shape{z.N, z.C, z.H, z.W}
                                             : Shape{z.K, z.channels(), z.R, z.S};
  return make(std::make_shared<Conv2d>(which, z), shape, {a, b});
}

// Operands: forward (x, w), dx (y, w), dw (x, y). All three are one trilinear form <y, conv(x, w)> with one factor left
// out.
Tensors Conv2d::vjp(const Tensors& in, const Tensor& out, const Tensor& g) const {
  switch (part) {
    case Part::forward: {
      const Tensor through = before_epilogue(flags, out, g);
      Tensors of = {make_part(Part::dx, through, in[1]), make_part(Part::dw, in[0], through)};
      if (flags & kBias)
        of.push_back(sum(through, {in[2].rank() == 1 ? std::vector<int>{0, 2, 3} : std::vector{2, 3}}));
      if (flags & kResidual) of.push_back(through);
      return of;
    }
    case Part::dx:
      return {make_part(Part::forward, g, in[1]), make_part(Part::dw, g, in[0])};
    default:
      return {make_part(Part::dx, in[1], g), make_part(Part::forward, in[0], g)};
  }
}

ConvSizes check(const Tensor& x, const Tensor& w, const Conv2dParams& p) {
  const Dims d = match("conv2d", {{"x", x, "N C H W"}, {"w", w, "K C/groups R S"}});
  const std::string given = text("[conv2d] x ", to_string(x.shape()), ", w ", to_string(w.shape()), ", stride ",
                                 p.stride, ", pad ", p.pad, ", groups ", p.groups, ": ");
  if ((x.dtype() != DType::f32 && x.dtype() != DType::f16) || w.dtype() != DType::f32)
    throw Error(Fault::internal, text(given, "want x in float32 or float16 and w in float32, got ", name_of(x.dtype()),
                                      " and ", name_of(w.dtype())));
  if (p.stride < 1 || p.pad < 0 || p.groups < 1)
    throw Error(Fault::internal, text(given, "want stride and groups from 1, pad from 0"));
  if (d["C/groups"] * p.groups != d["C"] || d["K"] % p.groups != 0)
    throw Error(Fault::internal, text(given, "want w [K, C/groups, R, S] with C = ", d["C"], " = groups * ",
                                      d["C/groups"], " and K = ", d["K"], " a multiple of groups"));
  if (d["R"] < 1 || d["S"] < 1 || d["H"] + 2 * p.pad < d["R"] || d["W"] + 2 * p.pad < d["S"])
    throw Error(Fault::internal,
                text(given, "the kernel of ", d["R"], "x", d["S"], " does not fit the padded input of ",
                     d["H"] + 2 * p.pad, "x", d["W"] + 2 * p.pad));
  const auto places = [&](int64_t size, int64_t taps) { return (size + 2 * p.pad - taps) / p.stride + 1; };
  return {d["N"], d["C"], d["H"], d["W"], d["K"], d["R"], d["S"], places(d["H"], d["R"]), places(d["W"], d["S"]), p};
}

void check_result(const char* op, const Tensor& y, const ConvSizes& z) {
  const Shape wanted{z.N, z.K, z.P, z.Q};
  if (y.shape() != wanted || y.dtype() != DType::f32)
    throw Error(Fault::internal, text("[", op, "] y has shape ", to_string(y.shape()), " and dtype ",
                                      name_of(y.dtype()), ", want float32 ", to_string(wanted)));
}

}  // namespace

Tensor conv2d(const Tensor& x, const Tensor& w, Conv2dParams params, const Epilogue& with) {
  const ConvSizes z = check(x, w, params);
  const Shape shape{z.N, z.K, z.P, z.Q};
  if (with.bias && with.bias.shape() != Shape{z.K} && with.bias.shape() != Shape{z.N, z.K})
    throw Error(Fault::internal, text("[conv2d] bias has shape ", to_string(with.bias.shape()), ", want [", z.K,
                                      "] or [", z.N, ",", z.K, "]"));
  if (with.residual && with.residual.shape() != shape)
    throw Error(Fault::internal,
                text("[conv2d] residual has shape ", to_string(with.residual.shape()), ", want ", to_string(shape)));
  Tensors in = {x, w};
  if (with.bias) in.push_back(with.bias);
  if (with.residual) in.push_back(with.residual);
  if (!fuses(in, with)) return conv2d_composed(x, w, params, with);
  return make(std::make_shared<Conv2d>(Part::forward, z, epilogue_flags(with)), shape, in);
}

Tensor conv2d_composed(const Tensor& x, const Tensor& w, Conv2dParams params, const Epilogue& with) {
  Tensor bias = with.bias;
  if (bias) bias = reshape(bias, {bias.rank() == 2 ? bias.dim(0) : 1, bias.dim(-1), 1, 1});
  return composed_epilogue(conv2d(x, w, params), bias, with);
}

Tensor conv2d_dx(const Tensor& y, const Tensor& w, const Shape& x_shape, Conv2dParams params) {
  const ConvSizes z = check(zeros(x_shape), w, params);
  check_result("conv2d_dx", y, z);
  return Conv2d(Part::dx, z).make_part(Part::dx, y, w);
}

Tensor conv2d_dw(const Tensor& x, const Tensor& y, const Shape& w_shape, Conv2dParams params) {
  const ConvSizes z = check(x, zeros(w_shape), params);
  check_result("conv2d_dw", y, z);
  return Conv2d(Part::dw, z).make_part(Part::dw, x, y);
}

}  // namespace cloam
