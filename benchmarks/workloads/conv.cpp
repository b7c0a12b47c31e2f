// Convolutions: forward and each adjoint alone. Names say taps, channels (in-out where they differ), image side or
// height x width, batch, and what else sets a layer apart; padding keeps the image's size (over the stride).
#include "benchmarks/workload.h"
#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

struct Layer {
  std::string name;
  int64_t batch, inputs, outputs, height, width, taps;
  int stride = 1, groups = 1;

  Conv2dParams params() const { return {.stride = stride, .pad = static_cast<int>(taps / 2), .groups = groups}; }
  Shape x() const { return {batch, inputs, height, width}; }
  Shape w() const { return {outputs, inputs / groups, taps, taps}; }
  Shape y() const { return {batch, outputs, (height - 1) / stride + 1, (width - 1) / stride + 1}; }
  double flops() const { return 2.0 * static_cast<double>(numel(y()) * numel(w())) / static_cast<double>(outputs); }
  double bytes() const { return 4.0 * static_cast<double>(numel(x()) + numel(w()) + numel(y())); }
};

Tensor leaf(const Shape& shape, uint64_t seed) {
  Tensor tensor = random_normal(shape, {seed});
  eval({tensor});
  return tensor;
}

void add(Workloads& all, const Layer& layer) {
  const std::string name = "conv." + layer.name;
  const Conv2dParams params = layer.params();
  const std::vector<std::string> peers = {"torch"};
  all.push_back({name + ".fwd", layer.flops(), layer.bytes(),
                 [=]() -> Run {
                   const Tensor x = leaf(layer.x(), 1), w = leaf(layer.w(), 2);
                   return [=] { eval({conv2d(x, w, params)}); };
                 },
                 peers});
  all.push_back({name + ".dx", layer.flops(), layer.bytes(),
                 [=]() -> Run {
                   const Tensor y = leaf(layer.y(), 1), w = leaf(layer.w(), 2);
                   return [=] { eval({conv2d_dx(y, w, layer.x(), params)}); };
                 },
                 peers});
  all.push_back({name + ".dw", layer.flops(), layer.bytes(),
                 [=]() -> Run {
                   const Tensor x = leaf(layer.x(), 1), y = leaf(layer.y(), 2);
                   return [=] { eval({conv2d_dw(x, y, layer.w(), params)}); };
                 },
                 peers});
}

/// As many channels out as in, stride 1: the sizes of the goals.
void add_square(Workloads& all, int64_t taps, int64_t channels, int64_t height, int64_t width) {
  const std::string side = height == width ? text(width) : text(height, "x", width);
  for (int64_t batch : {1, 8})
    add(all,
        {text(taps, "x", taps, ".", channels, ".", side, ".b", batch), batch, channels, channels, height, width, taps});
}

}  // namespace

void add_conv_workloads(Workloads& all) {
  add_square(all, 3, 64, 128, 128);
  add_square(all, 3, 256, 32, 32);
  add_square(all, 5, 32, 270, 480);
  add_square(all, 3, 256, 8, 8);
  add_square(all, 3, 512, 4, 4);
  add_square(all, 3, 512, 2, 2);
  add(all, {"1x1.256.32.b8", 8, 256, 256, 32, 32, 1});
  add(all, {"1x1.64.128.b1", 1, 64, 64, 128, 128, 1});
  add(all, {"3x3.128.64.b4.stride2", 4, 128, 128, 64, 64, 3, 2});
  add(all, {"3x3.256.16.b8.stride2", 8, 256, 256, 16, 16, 3, 2});
  add(all, {"3x3.3-64.512.b1", 1, 3, 64, 512, 512, 3});
  add(all, {"3x3.64-3.512.b1", 1, 64, 3, 512, 512, 3});
  add(all, {"3x3.128.64.b4.depthwise", 4, 128, 128, 64, 64, 3, 1, 128});
}

}  // namespace cloam
