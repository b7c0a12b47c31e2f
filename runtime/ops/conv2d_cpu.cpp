// Convolutions on CPU devices: how they are cut into tiles; how they sum is a function of the sizes alone.
#include <algorithm>

#include "runtime/ops/conv2d.h"
#include "runtime/ops/epilogue.h"
#include "runtime/variant.h"

namespace cloam {
namespace {

/// Scratch in local memory: floats of a work-item's tile of the input, taps of it.
struct Scratch {
  int tile, taps;
};
Scratch scratch() { return device().local_bytes < 600u << 10 ? Scratch{5120, 1024} : Scratch{128 << 10, 4096}; }

struct RowTiling {
  int64_t rows, columns, block_outputs = 0;             // results of a work-item
  int64_t height = 0, places = 0, used = 0, depth = 0;  // of the packed input tile
};

const Variant& rows_variant(const ConvPass& p) {
  if (p.outputs <= 4) return choose("conv2d", p.outputs == 1 ? "one" : "few");
  const int64_t width = ceil_div(p.out_width, p.dilation);
  return choose("conv2d", round_up(width, 16) < round_up(width, 32) ? "narrow" : "wide");
}

/// Input rows or columns that the results of all classes at one place reach over.
int64_t reach(int64_t taps, int64_t pad, int64_t dilation) {
  const auto floor_div = [](int64_t a, int64_t b) { return a >= 0 ? a / b : -((-a + b - 1) / b); };
  return floor_div(dilation + taps - 2 - pad, dilation) + floor_div(pad, dilation) + 1;
}

/// Nothing when even the smallest tile does not fit.
std::optional<RowTiling> row_tiling(const ConvPass& p, const Variant& v) {
  const Scratch room = scratch();
  const int64_t width = ceil_div(p.out_width, p.dilation), height = ceil_div(p.out_height, p.dilation);
  RowTiling t{.rows = std::min(round_up(8, v["NVY"]), round_up(height, v["NVY"])),
              .columns = std::min<int64_t>(128, round_up(width, v["NVX"] * 16))};
  const auto plane = [&] {
    t.height = (t.rows - 1) * p.stride + reach(p.R, p.pad_y, p.dilation);
    t.used = t.columns + (reach(p.S, p.pad_x, p.dilation) - 1) / p.stride;
    t.places = round_up(t.used, 16);
    return t.height * p.stride * t.places;
  };
  while (plane() * std::min<int64_t>(p.inputs, 32) > room.tile && t.columns > v["NVX"] * 16) t.columns -= v["NVX"] * 16;
  while (plane() * std::min<int64_t>(p.inputs, 32) > room.tile && t.rows > v["NVY"]) t.rows -= v["NVY"];
  t.depth = std::min({p.inputs, room.tile / plane(), room.taps / (p.R * p.S)});
  if (t.depth < 1) return std::nullopt;
  const int64_t tiles = ceil_div(height, t.rows) * ceil_div(width, t.columns) * p.images * p.groups;
  // Enough work-items for the cores (which changes no sum), but packing the input pays from 32 output channels on.
  const int64_t wanted = std::max<int64_t>(1, 4 * device().compute_units / tiles);
  t.block_outputs = round_up(std::clamp<int64_t>(ceil_div(p.outputs, wanted), 32, 256), v["MR"]);
  return t;
}

Range named(Range range, double flops) {
  range.flops = flops;
  return range;
}

constexpr int64_t kChannels = 64;  // packed by a work-item

/// Where the weight of (group, output, input) lies.
struct WeightStrides {
  int64_t output, input;
};
WeightStrides weight_strides(const ConvPass& p) {
  const int64_t taps = p.R * p.S, filter = taps * (p.flip ? p.outputs : p.inputs);
  return {p.flip ? taps : filter, p.flip ? filter : taps};
}

/// Weights in blocks of `block` outputs.
Tensor packed_weights(const ConvPass& p, const Tensor& w, int block) {
  const int64_t blocks = p.groups * ceil_div(p.outputs, block);
  const WeightStrides stride = weight_strides(p);
  const Tensor packed = empty({blocks * block, p.inputs * p.R * p.S});
  launch(kernel("conv2d_small_cpu", "pack_weights", {{"BLOCK", block}, {"MAX_TAPS", 1}}), "conv2d_pack",
         range2(blocks, ceil_div(p.inputs, kChannels)), w, packed, p.outputs, p.inputs, p.R, p.S, stride.output,
         stride.input, w.numel(), p.flip, p.dilation, p.pad_y, p.pad_x, kChannels);
  return packed;
}

struct Ending {
  const Tensor &bias, &residual;
  int64_t bias_step;
};
Ending ending(const ConvPass& p, int epilogue, const Tensors& in) {
  const Tensor &bias = epilogue & kBias ? in[2] : in[1], &residual = epilogue & kResidual ? in.back() : in[1];
  return {bias, residual, bias.rank() == 2 ? p.groups * p.outputs : 0};
}

bool run_rows(const ConvSizes& z, const ConvPass& p, int epilogue, const Tensors& in, const Tensor& out) {
  const Variant& v = rows_variant(p);
  const auto t = row_tiling(p, v);
  if (!t) return false;
  const Scratch room = scratch();
  const Tensor packed = packed_weights(p, in[1], v["MR"]);
  Range range = range2(
      ceil_div(ceil_div(p.out_height, p.dilation), t->rows) * ceil_div(ceil_div(p.out_width, p.dilation), t->columns),
      p.groups * ceil_div(p.outputs, t->block_outputs));
  range.global[2] = static_cast<size_t>(p.images);
  const Ending end = ending(p, epilogue, in);
  launch(kernel(v, {{"TILE", room.tile}, {"TAPS", room.taps}}), p.flip ? "conv2d_dx" : "conv2d",
         named(range, z.flops()), in[0], packed, out, end.bias, end.residual, p.inputs, p.in_height, p.in_width,
         p.outputs, p.out_height, p.out_width, p.R, p.S, p.stride, p.dilation, p.pad_y, p.pad_x, t->rows, t->columns,
         t->height, t->places, t->used, t->depth, t->block_outputs, p.groups, end.bias_step, epilogue);
  return true;
}

constexpr int kMaxTaps = 64, kLines = 32;

bool is_small(const ConvPass& p) {
  return p.outputs >= 16 && p.R * p.S <= kMaxTaps && p.out_height * p.out_width <= (p.images > 4 ? 256 : 64);
}

/// Lines of eight images' pixels, or of eight pixels where there are few images.
struct Lines {
  bool by_image;
  int64_t each, count;  // of an image or eight images, of all
};
Lines lines_of(const ConvPass& p) {
  const int64_t results = p.out_height * p.out_width;
  if (p.images > 4) return {true, results, ceil_div(p.images, 8) * results};
  return {false, ceil_div(results, 8), p.images * ceil_div(results, 8)};
}

Tensor packed_lines(const ConvPass& p, const Lines& lines, const Tensor& x, const Constants& constants) {
  const int64_t channels = p.groups * p.inputs, pixels = p.in_height * p.in_width;
  const int64_t chunks = ceil_div(channels, kChannels), pieces = lines.count / (lines.by_image ? lines.each : 1);
  const Tensor packed = empty({pieces, channels, lines.by_image ? pixels : p.R * p.S, 8});
  if (lines.by_image)
    launch(kernel("conv2d_small_cpu", "pack_images", constants), "conv2d_pack", range2(pieces, chunks), x, packed,
           p.images, channels, pixels, kChannels);
  else
    launch(kernel("conv2d_small_cpu", "pack_pixels", constants), "conv2d_pack", range2(pieces, chunks), x, packed,
           p.images, channels, p.in_height, p.in_width, p.out_height, p.out_width, p.R, p.S, p.stride, p.dilation,
           p.pad_y, p.pad_x, kChannels);
  return packed;
}

void run_lines(const ConvSizes& z, const ConvPass& p, int epilogue, const Tensors& in, const Tensor& out) {
  const Variant& v = choose("conv2d_small");
  const int block = v["BLOCK"];
  Constants constants = v.constants;
  constants.insert(constants.end(), {{"MAX_TAPS", kMaxTaps}, {"LINES", kLines}});
  const Lines lines = lines_of(p);
  const int64_t blocks = p.groups * ceil_div(p.outputs, block), parts = ceil_div(lines.count, kLines);
  const int64_t chunk = ceil_div(lines.count, parts);
  // Weights packed at a time: what the first cache holds beside a line's inputs.
  const int64_t depth = std::clamp<int64_t>(4608 / (p.R * p.S * block), 1, p.inputs);
  const Tensor packed = packed_lines(p, lines, in[0], constants),
               room = empty({parts * blocks, depth * p.R * p.S, block});
  const WeightStrides stride = weight_strides(p);
  const Ending end = ending(p, epilogue, in);
  launch(kernel("conv2d_small_cpu", v.kernel.c_str(), constants), p.flip ? "conv2d_dx" : "conv2d",
         named(range2(parts, blocks), z.flops()), packed, in[1], room, out, end.bias, end.residual, p.images, p.inputs,
         p.in_height, p.in_width, p.outputs, p.out_height, p.out_width, p.R, p.S, p.stride, p.dilation, p.pad_y,
         p.pad_x, p.groups, stride.output, stride.input, in[1].numel(), p.flip, lines.by_image, lines.count, chunk,
         depth, end.bias_step, epilogue);
}

/// How the weights' gradient is cut, conv2d_dw_cpu.cl.
struct GradientTiling {
  bool unfold = false;                        // every tap of a channel is a channel of the product
  int64_t channels = 0, taps = 0;             // of the product
  int64_t images = 1, rows = 0, columns = 0;  // of a tile
  int64_t block_filters = 64, parts = 1, blocks = 1;
  bool at_once = false;
};

GradientTiling unfolding(const ConvSizes& z) {
  const int64_t taps = z.R * z.S;
  const bool unfold = z.channels() < 16 && taps > 1 && z.with.stride == 1;
  return {.unfold = unfold, .channels = z.channels() * (unfold ? taps : 1), .taps = unfold ? 1 : taps};
}

const Variant& gradient_variant(const ConvSizes& z, int64_t channels) {
  if (z.channels() == 1 && z.filters() < 8) return choose("conv2d_dw", "single");
  if (z.filters() <= 4 && channels > 32) return choose("conv2d_dw", "few");
  if (channels <= 16) return choose("conv2d_dw", "narrow");
  return choose("conv2d_dw", round_up(channels, 32) < round_up(channels, 64) ? "half" : "wide");
}

constexpr int64_t kTilePixels = 512;

/// False when even the smallest tile does not fit.
bool cut_gradient(const ConvSizes& z, int64_t block_channels, GradientTiling& t) {
  const int64_t R = t.unfold ? 1 : z.R, S = t.unfold ? 1 : z.S, stride = z.with.stride;
  const int64_t room = scratch().tile, most = room < 64 << 10 ? 256 : kTilePixels;
  t.columns = ceil_div(z.Q, ceil_div(z.Q, 64));
  t.rows = std::clamp<int64_t>(most / t.columns, 1, z.P);
  const auto floats = [&] { return ((t.rows - 1) * stride + R) * ((t.columns - 1) * stride + S) * block_channels; };
  while (floats() > room && t.rows > 1) t.rows = ceil_div(t.rows, 2);
  while (floats() > room && t.columns > 1) t.columns = ceil_div(t.columns, 2);
  if (floats() > room) return false;
  if (t.rows == z.P && t.columns == z.Q)
    t.images = std::clamp<int64_t>(std::min(room / floats(), most / (t.rows * t.columns)), 1, z.N);
  const int64_t tiles = ceil_div(z.P, t.rows) * ceil_div(z.Q, t.columns) * ceil_div(z.N, t.images);
  t.blocks = z.with.groups * ceil_div(z.filters(), t.block_filters) * ceil_div(t.channels, block_channels);
  t.parts = std::clamp<int64_t>(ceil_div(16, t.blocks), 1, tiles);
  t.at_once = tiles == 1 && t.taps <= 32 && most == kTilePixels;
  return true;
}

bool run_planes(const ConvSizes& z, const Variant& v, const Tensors& in, const Tensor& out) {
  launch(kernel(v, {{"TILE", 1}, {"GROW", 1}, {"TAPS", 1}}), "conv2d_dw", named(range1(z.K), z.flops()), in[0], in[1],
         out, z.N, z.C, z.H, z.W, z.K, z.P, z.Q, z.R, z.S, z.with.stride, z.with.pad);
  return true;
}

}  // namespace

ConvPass forward_pass(const ConvSizes& z) {
  return {z.N, z.with.groups, z.channels(),  z.H, z.W,        z.filters(), z.P,  z.Q,
          z.R, z.S,           z.with.stride, 1,   z.with.pad, z.with.pad,  false};
}

ConvPass backward_pass(const ConvSizes& z) {
  return {z.N,           z.with.groups,        z.filters(),          z.P, z.Q, z.channels(), z.H, z.W, z.R, z.S, 1,
          z.with.stride, z.R - 1 - z.with.pad, z.S - 1 - z.with.pad, true};
}

bool run_conv2d_cpu(const ConvSizes& sizes, const ConvPass& pass, int epilogue, const Tensors& in, const Tensor& out) {
  if (!is_small(pass)) return run_rows(sizes, pass, epilogue, in, out);
  run_lines(sizes, pass, epilogue, in, out);
  return true;
}

bool run_conv2d_dw_cpu(const ConvSizes& z, const Tensors& in, const Tensor& out) {
  GradientTiling t = unfolding(z);
  const Variant& v = gradient_variant(z, t.channels);
  if (v.kernel == "conv2d_dw_planes") return run_planes(z, v, in, out);
  if (!cut_gradient(z, v["CB"], t)) return false;
  const bool roomy = scratch().tile >= 64 << 10;
  Constants constants = v.constants;
  constants.insert(constants.end(),
                   {{"TILE", scratch().tile}, {"GROW", roomy ? kTilePixels : 256}, {"TAPS", roomy ? 32 : 1}});
  const int64_t groups = z.with.groups;
  const Tensor partial =
      t.at_once ? empty({1})
                : empty({t.parts, groups * t.taps, round_up(z.filters(), v["DR"]), round_up(t.channels, v["CB"])});
  launch(kernel("conv2d_dw_cpu", v.kernel.c_str(), constants), "conv2d_dw", named(range2(t.parts, t.blocks), z.flops()),
         in[0], in[1], partial, out, z.N, z.channels(), z.H, z.W, z.filters(), z.P, z.Q, z.R, z.S, z.with.stride,
         z.with.pad, t.images, t.rows, t.columns, t.block_filters, groups, t.parts, t.unfold, t.at_once);
  if (!t.at_once)
    launch(kernel("conv2d_dw_cpu", "conv2d_dw_sum", constants), "conv2d_dw_sum",
           range2(z.K, ceil_div(t.channels, v["CB"])), partial, out, t.channels, z.filters(), t.taps, groups, t.parts);
  return true;
}

}  // namespace cloam
