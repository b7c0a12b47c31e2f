// Convolution and its adjoints on GPU-class devices: three matrix products of one kernel.
#include <algorithm>

#include "runtime/ops/conv2d.h"
#include "runtime/ops/epilogue.h"
#include "runtime/variant.h"

namespace cloam {
namespace {

/// The arguments of conv2d_tiled, kernels/conv2d_gpu.cl: sizes of the product, then where a, the image and c lie.
struct GpuWalk {
  int64_t columns, plane, step, first, outer;
};
struct Product {
  int64_t m, n, depth;
  int64_t a_row, a_inner, a_outer, a_group;
  int64_t image_group, height, width, spread;
  GpuWalk j, k;
  int64_t c_row, c_inner, c_outer, c_group;
};

Product forward_product(const ConvSizes& z) {
  const int64_t c = z.channels(), k = z.filters(), taps = z.R * z.S, depth = c * taps;
  return {.m = k,
          .n = z.N * z.P * z.Q,
          .depth = depth,
          .a_row = depth,
          .a_inner = depth,
          .a_outer = 0,
          .a_group = k * depth,
          .image_group = c * z.H * z.W,
          .height = z.H,
          .width = z.W,
          .spread = 1,
          .j = {z.Q, z.P * z.Q, z.with.stride, -z.with.pad, z.C * z.H * z.W},
          .k = {z.S, taps, 1, 0, z.H * z.W},
          .c_row = z.P * z.Q,
          .c_inner = z.P * z.Q,
          .c_outer = z.K * z.P * z.Q,
          .c_group = k * z.P * z.Q};
}

Product dx_product(const ConvSizes& z) {
  const int64_t c = z.channels(), k = z.filters(), taps = z.R * z.S;
  return {.m = c,
          .n = z.N * z.H * z.W,
          .depth = k * taps,
          .a_row = taps,
          .a_inner = taps,
          .a_outer = c * taps,
          .a_group = k * c * taps,
          .image_group = k * z.P * z.Q,
          .height = z.P,
          .width = z.Q,
          .spread = z.with.stride,
          .j = {z.W, z.H * z.W, 1, z.with.pad, z.K * z.P * z.Q},
          .k = {z.S, taps, -1, 0, z.P * z.Q},
          .c_row = z.H * z.W,
          .c_inner = z.H * z.W,
          .c_outer = z.C * z.H * z.W,
          .c_group = c * z.H * z.W};
}

Product dw_product(const ConvSizes& z) {
  const int64_t c = z.channels(), k = z.filters(), taps = z.R * z.S, plane = z.P * z.Q;
  return {.m = k,
          .n = c * taps,
          .depth = z.N * plane,
          .a_row = plane,
          .a_inner = plane,
          .a_outer = z.K * plane,
          .a_group = k * plane,
          .image_group = c * z.H * z.W,
          .height = z.H,
          .width = z.W,
          .spread = 1,
          .j = {z.S, taps, 1, 0, z.H * z.W},
          .k = {z.Q, plane, z.with.stride, -z.with.pad, z.C * z.H * z.W},
          .c_row = c * taps,
          .c_inner = c * taps,
          .c_outer = 0,
          .c_group = k * c * taps};
}

struct Operands {
  const Tensor &a, &image, &bias, &residual;
  int64_t bias_step = 0;
  int epilogue = 0;
};

void run_product(const char* name, const Product& p, const Operands& of, int64_t groups, const Tensor& out) {
  const Variant& v = choose("conv2d", p.m <= 32 ? "narrow" : "any");
  // Weight gradients have few tiles but a long sum: share it out. A sum with an epilogue stays whole. The order of a
  // sum must not depend on the variant: tiles of 64 x 64 are counted whatever it takes.
  const int64_t tiles = ceil_div(p.n, 64) * ceil_div(p.m, 64);
  constexpr int64_t kGroups = 128, kMinDepth = 1024;
  const int64_t wanted = of.epilogue ? 1 : std::min(ceil_div(kGroups, tiles * groups), ceil_div(p.depth, kMinDepth));
  const int64_t k_each = round_up(ceil_div(p.depth, wanted), v["TK"]), splits = ceil_div(p.depth, k_each);
  const int64_t count = out.numel();
  const Tensor to = splits == 1 ? out : empty({splits, count});
  const int side = v["LANES"] == 64 ? 8 : 16;  // of the square that a group is
  Range range = range2(ceil_div(p.n, v["TN"]) * side, ceil_div(p.m, v["TM"]) * side);
  range.global[2] = static_cast<size_t>(groups * splits);
  range.local = {static_cast<size_t>(side), static_cast<size_t>(side), 1};
  range.flops = 2.0 * static_cast<double>(groups * p.m) * static_cast<double>(p.n * p.depth);
  const Constants halves = of.image.dtype() == DType::f16 ? Constants{{"HALF", 1}} : Constants{};
  launch(kernel(v, halves), name, range, of.a, of.image, to, of.bias, of.residual, p.m, p.n, p.depth, p.a_row,
         p.a_inner, p.a_outer, p.a_group, p.image_group, p.height, p.width, p.spread, p.j.columns, p.j.plane, p.j.step,
         p.j.first, p.j.outer, p.k.columns, p.k.plane, p.k.step, p.k.first, p.k.outer, p.c_row, p.c_inner, p.c_outer,
         p.c_group, splits == 1 ? 0 : count, splits, k_each, of.bias_step, of.epilogue);
  if (splits > 1) launch(kernel(v, "add_parts", halves), "conv2d_add", elements(count), to, out, count, splits);
}

}  // namespace

void run_conv2d_gpu(const ConvSizes& z, int epilogue, const Tensors& in, const Tensor& out) {
  const Tensor &bias = epilogue & kBias ? in[2] : in[1], &residual = epilogue & kResidual ? in.back() : in[1];
  run_product("conv2d", forward_product(z), {in[1], in[0], bias, residual, bias.rank() == 2 ? z.K : 0, epilogue},
              z.with.groups, out);
}

void run_conv2d_dx_gpu(const ConvSizes& z, const Tensors& in, const Tensor& out) {
  run_product("conv2d_dx", dx_product(z), {in[1], in[0], in[0], in[0]}, z.with.groups, out);
}

void run_conv2d_dw_gpu(const ConvSizes& z, const Tensors& in, const Tensor& out) {
  run_product("conv2d_dw", dw_product(z), {in[1], in[0], in[0], in[0]}, z.with.groups, out);
}

}  // namespace cloam
