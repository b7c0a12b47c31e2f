// Convolution over images and its two adjoints: each is linear in both operands, so the three are closed under
// gradients.
#include <algorithm>

#include "runtime/cl.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

const Registered kRegistered[] = {Registered("conv2d"), Registered("conv2d_dx"), Registered("conv2d_dw")};

int64_t ceil_div(int64_t a, int64_t b) { return (a + b - 1) / b; }
int64_t round_up(int64_t a, int64_t b) { return ceil_div(a, b) * b; }

/// x [N,C,H,W], w [K,C/groups,R,S], y [N,K,P,Q].
struct Sizes {
  int64_t N, C, H, W, K, R, S, P, Q;
  Conv2dParams with;
  int64_t channels() const { return C / with.groups; }  // of one group
  int64_t filters() const { return K / with.groups; }
  double flops() const { return 2.0 * static_cast<double>(N * K * P * Q) * static_cast<double>(channels() * R * S); }
  bool empty() const { return N * C * H * W * K * P * Q * R * S == 0; }
};

/// How a convolution is cut for CPU devices: a function of the sizes alone.
struct Tiling {
  int mr = 8, vw = 16, nvx = 2, nvy = 1;              // registers: output channels x rows x vectors of pixels
  int64_t rows = 8, columns = 32, block_outputs = 0;  // results of a work-item
  int64_t height = 0, places = 0, depth = 0;          // of the packed input tile
};

/// The forward pass and the adjoint in x, seen as one thing: a convolution of `in` (its elements `dilation` apart).
struct Pass {
  int64_t images, groups, inputs, in_height, in_width, outputs, out_height, out_width, R, S, stride, dilation, pad_y,
      pad_x;
  bool flip;
};

Pass forward_pass(const Sizes& z) {
  return {z.N, z.with.groups, z.channels(),  z.H, z.W,        z.filters(), z.P,  z.Q,
          z.R, z.S,           z.with.stride, 1,   z.with.pad, z.with.pad,  false};
}

Pass backward_pass(const Sizes& z) {
  return {z.N,           z.with.groups,        z.filters(),          z.P, z.Q, z.channels(), z.H, z.W, z.R, z.S, 1,
          z.with.stride, z.R - 1 - z.with.pad, z.S - 1 - z.with.pad, true};
}

/// Scratch sizes in local memory: what a work-item's tile of the input may take.
struct Scratch {
  int tile, taps;
};
Scratch scratch() { return device().local_bytes < 600u << 10 ? Scratch{5120, 1024} : Scratch{128 << 10, 4096}; }

void choose_registers(Tiling& t, const Pass& p) {
  if (p.out_width <= 8)
    t.mr = 4, t.vw = 8, t.nvx = 1, t.nvy = 4;
  else if (round_up(p.out_width, 16) < round_up(p.out_width, 32))
    t.nvx = 1, t.nvy = 2;
  if (p.outputs <= 4) t.mr = p.outputs == 1 ? 1 : 4;
}

/// Nothing when even the smallest tile does not fit.
std::optional<Tiling> tiling(const Pass& p) {
  Tiling t;
  choose_registers(t, p);
  const Scratch room = scratch();
  const int64_t step = t.nvx * t.vw;
  t.columns = std::min<int64_t>(32, round_up(p.out_width, step));
  t.rows = std::min<int64_t>(8, round_up(p.out_height, t.nvy));
  const auto plane = [&] {
    t.height = (t.rows - 1) * p.stride + p.R;
    t.places = t.columns + (p.S - 1) / p.stride;
    if (t.columns > 8) t.places = round_up(t.places, 16);
    return t.height * p.stride * t.places;
  };
  while (plane() * std::min<int64_t>(p.inputs, 32) > room.tile && t.rows > t.nvy)
    t.rows = std::max<int64_t>(t.nvy, t.rows / 2);
  t.depth = std::min({p.inputs, room.tile / plane(), room.taps / (p.R * p.S)});
  if (t.depth < 1) return std::nullopt;
  const int64_t tiles = ceil_div(p.out_height, t.rows) * ceil_div(p.out_width, t.columns) * p.images * p.groups;
  // Enough work-items for the cores, but packing the input pays from 32 output channels on.
  const int64_t wanted = std::max<int64_t>(1, 32 / tiles);
  t.block_outputs = round_up(std::clamp<int64_t>(ceil_div(p.outputs, wanted), 32, 128), t.mr);
  return t;
}

void run_tiles(const Pass& p, const Tiling& t, const Tensors& in, const Tensor& out) {
  const Scratch room = scratch();
  const Constants constants = {{"MR", t.mr},        {"VW", t.vw}, {"NVX", t.nvx}, {"NVY", t.nvy}, {"TILE", room.tile},
                               {"TAPS", room.taps}, {"CB", 16},   {"DR", 1},      {"GROW", 1}};
  const int64_t taps = p.R * p.S, blocks = ceil_div(p.outputs, t.mr), filter = taps * (p.flip ? p.outputs : p.inputs);
  const Tensor packed = empty({p.groups * blocks * t.mr, p.inputs * taps});
  constexpr int64_t kChunk = 16;
  launch(kernel("conv2d_cpu", "pack_weights", constants), "pack_weights",
         range2(p.groups * blocks, ceil_div(p.inputs, kChunk)), in[1], packed, p.outputs, p.inputs, taps,
         p.inputs * p.outputs * taps, p.flip ? taps : filter, p.flip ? filter : taps, p.flip, kChunk);
  Range range = range2(ceil_div(p.out_height, t.rows) * ceil_div(p.out_width, t.columns),
                       p.groups * ceil_div(p.outputs, t.block_outputs));
  range.global[2] = static_cast<size_t>(p.images);
  range.flops = 2.0 * static_cast<double>(p.images * p.groups * p.outputs * p.inputs * taps) *
                static_cast<double>(std::min(p.out_height * p.out_width, p.in_height * p.in_width));
  launch(kernel("conv2d_cpu", "conv2d_tiles", constants), p.flip ? "conv2d_dx" : "conv2d", range, in[0], packed, out,
         p.inputs, p.in_height, p.in_width, p.outputs, p.out_height, p.out_width, p.R, p.S, p.stride, p.dilation,
         p.pad_y, p.pad_x, t.rows, t.columns, t.height, t.places, t.depth, t.block_outputs, p.groups);
}

struct GradientTiling {
  int cb = 64, dr = 8, grow = 1024;
  int64_t rows = 4, columns = 64, block_filters = 64, parts = 1, blocks = 1;
};

std::optional<GradientTiling> gradient_tiling(const Sizes& z) {
  GradientTiling t;
  const int64_t channels = z.channels();
  if (channels <= 16)
    t.cb = 16;
  else if (round_up(channels, 32) < round_up(channels, 64))
    t.cb = 32;
  t.columns = std::min<int64_t>(64, z.Q);
  t.rows = std::clamp<int64_t>(256 / t.columns, 1, z.P);
  const int64_t room = scratch().tile;
  const auto floats = [&] {
    return ((t.rows - 1) * z.with.stride + z.R) * ((t.columns - 1) * z.with.stride + z.S) * t.cb;
  };
  while (floats() > room && t.rows > 1) t.rows /= 2;
  while (floats() > room && t.columns > 1) t.columns /= 2;
  if (floats() > room) return std::nullopt;
  if (room < 64 << 10) t.grow = 256;
  const int64_t tiles = ceil_div(z.P, t.rows) * ceil_div(z.Q, t.columns) * z.N;
  t.blocks = z.with.groups * ceil_div(z.filters(), t.block_filters) * ceil_div(channels, t.cb);
  t.parts = std::clamp<int64_t>(ceil_div(16, t.blocks), 1, tiles);
  return t;
}

void run_gradient(const Sizes& z, const GradientTiling& t, const Tensors& in, const Tensor& out) {
  const Constants constants = {{"MR", 1},   {"VW", 16},   {"NVX", 1},   {"NVY", 1},      {"TILE", scratch().tile},
                               {"TAPS", 1}, {"CB", t.cb}, {"DR", t.dr}, {"GROW", t.grow}};
  const int64_t groups = z.with.groups, taps = z.R * z.S;
  const Tensor partial = empty({t.parts, groups * taps, round_up(z.filters(), t.dr), round_up(z.channels(), t.cb)});
  Range range = range2(t.parts, t.blocks);
  range.flops = z.flops();
  launch(kernel("conv2d_cpu", "conv2d_dw_tiles", constants), "conv2d_dw", range, in[0], in[1], partial, z.N,
         z.channels(), z.H, z.W, z.filters(), z.P, z.Q, z.R, z.S, z.with.stride, z.with.pad, t.rows, t.columns,
         t.block_filters, groups, t.parts);
  launch(kernel("conv2d_cpu", "conv2d_dw_sum", constants), "conv2d_dw_sum", range2(z.K, ceil_div(z.channels(), t.cb)),
         partial, out, z.channels(), z.filters(), taps, groups, t.parts);
}

enum class Part { forward, dx, dw };

struct Conv2d final : Op {
  Conv2d(Part which, const Sizes& s) : part(which), sizes(s) {}
  const char* name() const override {
    return part == Part::forward ? "conv2d" : part == Part::dx ? "conv2d_dx" : "conv2d_dw";
  }
  void run(const Tensors& in, Tensor& out) const override {
    if (!is_cpu_class() || reference_variants() || sizes.empty()) return run_reference(in, out);
    if (part == Part::dw) {
      if (const auto t = gradient_tiling(sizes)) return run_gradient(sizes, *t, in, out);
    } else {
      const Pass pass = part == Part::forward ? forward_pass(sizes) : backward_pass(sizes);
      if (const auto t = tiling(pass)) return run_tiles(pass, *t, in, out);
    }
    run_reference(in, out);
  }
  void run_reference(const Tensors& in, const Tensor& out) const;
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override;
  Tensor make_part(Part which, const Tensor& a, const Tensor& b) const;
  Part part;
  Sizes sizes;
};

void Conv2d::run_reference(const Tensors& in, const Tensor& out) const {
  const Sizes& z = sizes;
  const bool dw = part == Part::dw;
  Range range = elements(dw ? z.channels() * z.R * z.S : out.dim(2) * out.dim(3));
  range.global[1] = static_cast<size_t>(dw ? z.K : out.dim(0) * out.dim(1));
  range.flops = z.flops();
  cl::Kernel& k = kernel("conv2d", name());
  Arguments arguments(k);
  for (const Tensor& t : {in[0], in[1], out}) arguments.add(t);
  if (dw) arguments.add(z.N);
  for (int64_t size : {z.C, z.H, z.W, z.K, z.R, z.S, z.P, z.Q}) arguments.add(size);
  for (int value : {z.with.stride, z.with.pad, z.with.groups}) arguments.add(value);
  enqueue(k, name(), range, arguments.bytes());
}

Tensor Conv2d::make_part(Part which, const Tensor& a, const Tensor& b) const {
  const Sizes& z = sizes;
  const Shape shape = which == Part::forward ? Shape{z.N, z.K, z.P, z.Q}
                      : which == Part::dx    ? Shape{z.N, z.C, z.H, z.W}
                                             : Shape{z.K, z.channels(), z.R, z.S};
  return make(std::make_shared<Conv2d>(which, z), shape, {a, b});
}

// Operands: forward (x, w), dx (y, w), dw (x, y). All three are one trilinear form <y, conv(x, w)> with one factor left
// out.
Tensors Conv2d::vjp(const Tensors& in, const Tensor&, const Tensor& g) const {
  switch (part) {
    case Part::forward:
      return {make_part(Part::dx, g, in[1]), make_part(Part::dw, in[0], g)};
    case Part::dx:
      return {make_part(Part::forward, g, in[1]), make_part(Part::dw, g, in[0])};
    default:
      return {make_part(Part::dx, in[1], g), make_part(Part::forward, in[0], g)};
  }
}

Sizes check(const Tensor& x, const Tensor& w, const Conv2dParams& p) {
  const Dims d = match("conv2d", {{"x", x, "N C H W"}, {"w", w, "K C/groups R S"}});
  const std::string given = text("[conv2d] x ", to_string(x.shape()), ", w ", to_string(w.shape()), ", stride ",
                                 p.stride, ", pad ", p.pad, ", groups ", p.groups, ": ");
  if (x.dtype() != DType::f32 || w.dtype() != DType::f32)
    throw Error(Fault::internal, text(given, "want float32, got ", name_of(x.dtype()), " and ", name_of(w.dtype())));
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

void check_result(const char* op, const Tensor& y, const Sizes& z) {
  const Shape wanted{z.N, z.K, z.P, z.Q};
  if (y.shape() != wanted || y.dtype() != DType::f32)
    throw Error(Fault::internal, text("[", op, "] y has shape ", to_string(y.shape()), " and dtype ",
                                      name_of(y.dtype()), ", want float32 ", to_string(wanted)));
}

}  // namespace

Tensor conv2d(const Tensor& x, const Tensor& w, Conv2dParams params) {
  const Sizes z = check(x, w, params);
  const Conv2d op(Part::forward, z);
  return op.make_part(Part::forward, x, w);
}

Tensor conv2d_dx(const Tensor& y, const Tensor& w, const Shape& x_shape, Conv2dParams params) {
  const Sizes z = check(zeros(x_shape), w, params);
  check_result("conv2d_dx", y, z);
  return Conv2d(Part::dx, z).make_part(Part::dx, y, w);
}

Tensor conv2d_dw(const Tensor& x, const Tensor& y, const Shape& w_shape, Conv2dParams params) {
  const Sizes z = check(x, zeros(w_shape), params);
  check_result("conv2d_dw", y, z);
  return Conv2d(Part::dw, z).make_part(Part::dw, x, y);
}

}  // namespace cloam
