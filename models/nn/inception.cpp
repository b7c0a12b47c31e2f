// See inception.h. Names of modules and branches are torchvision's; where TensorFlow's graph differs from torchvision,
// the graph counts: NeighbourMean leaves out what lies outside, and the last module takes the largest neighbour.
#include "models/nn/inception.h"

#include <algorithm>
#include <cmath>

#include "models/io/safetensors_header.h"  // shape_text
#include "runtime/error.h"

namespace cloam {
namespace {

using Chain = std::vector<FeatureLayer>;

struct Kernel {
  std::string name;
  int64_t out, rows = 1, columns = 1;
  int stride = 1;
  bool padded = true;
};

/// The convolution has no bias, a batch normalisation follows. Both are linear in x and become one convolution:
/// (w x - mean) gamma / sqrt(variance + epsilon) + beta.
FeatureConvolution read_normalised(const Weights& from, const std::string& module, int64_t in, const Kernel& kernel) {
  constexpr double kEpsilon = 1e-3;
  const Shape shape{kernel.out, in, kernel.rows, kernel.columns};
  const std::string norm = module + ".bn.";
  std::vector<float> weight = from.take(module + ".conv.weight", {shape.begin(), shape.end()});
  const auto of_norm = [&](const char* name) { return from.take(norm + name, {kernel.out}); };
  const std::vector<float> gamma = of_norm("weight"), mean = of_norm("running_mean"), variance = of_norm("running_var");
  std::vector<float> bias = of_norm("bias");
  const size_t taps = weight.size() / bias.size();
  for (size_t k = 0; k < bias.size(); k++) {
    if (variance[k] < 0)
      throw Error(Fault::data, text(from.file.string(), ": ", norm, "running_var has a value below 0: ", variance[k]));
    const double factor = double{gamma[k]} / std::sqrt(double{variance[k]} + kEpsilon);
    bias[k] = static_cast<float>(double{bias[k]} - factor * double{mean[k]});
    for (size_t i = k * taps; i < (k + 1) * taps; i++) weight[i] = static_cast<float>(factor * double{weight[i]});
  }
  return {from_host(weight, shape), from_host(bias, {kernel.out}), kernel.stride, kernel.padded ? kHalfKernel : 0};
}

/// Reads the convolutions of one module, "Mixed_5b.branch1x1" and so on.
struct Module {
  const Weights& from;
  std::string name;
  int64_t in;

  Chain chain(const std::vector<Kernel>& kernels) const {
    Chain layers;
    int64_t channels = in;
    for (const Kernel& kernel : kernels) {
      layers.push_back({"", read_normalised(from, name + "." + kernel.name, channels, kernel)});
      channels = kernel.out;
    }
    return layers;
  }

  Chain pooled(const FeatureLayer& pooling, int64_t out) const {
    return {pooling, {"", read_normalised(from, name + ".branch_pool", in, {"", out})}};
  }

  /// A chain that ends in 1x3 and 3x1 side by side, `last`a and `last`b.
  Chain ending_in_two(const std::vector<Kernel>& kernels, const std::string& last) const {
    constexpr int64_t kOut = 384;
    const Module end{from, name, kernels.back().out};
    Chain layers = chain(kernels);
    layers.push_back({"", Branches{{end.chain({{last + "a", kOut, 1, 3}}), end.chain({{last + "b", kOut, 3, 1}})}}});
    return layers;
  }
};

const FeatureLayer kHalving = {"", Pooling{3, 2}};

FeatureLayer module_a(const Module& m, int64_t pooled) {
  return {"", Branches{{m.chain({{"branch1x1", 64}}), m.chain({{"branch5x5_1", 48}, {"branch5x5_2", 64, 5, 5}}),
                        m.chain({{"branch3x3dbl_1", 64}, {"branch3x3dbl_2", 96, 3, 3}, {"branch3x3dbl_3", 96, 3, 3}}),
                        m.pooled({"", NeighbourMean{}}, pooled)}}};
}

FeatureLayer module_b(const Module& m) {
  return {
      "",
      Branches{{m.chain({{"branch3x3", 384, 3, 3, 2, false}}),
                m.chain({{"branch3x3dbl_1", 64}, {"branch3x3dbl_2", 96, 3, 3}, {"branch3x3dbl_3", 96, 3, 3, 2, false}}),
                {kHalving}}}};
}

FeatureLayer module_c(const Module& m, int64_t inner) {
  return {"", Branches{{m.chain({{"branch1x1", 192}}),
                        m.chain({{"branch7x7_1", inner}, {"branch7x7_2", inner, 1, 7}, {"branch7x7_3", 192, 7, 1}}),
                        m.chain({{"branch7x7dbl_1", inner},
                                 {"branch7x7dbl_2", inner, 7, 1},
                                 {"branch7x7dbl_3", inner, 1, 7},
                                 {"branch7x7dbl_4", inner, 7, 1},
                                 {"branch7x7dbl_5", 192, 1, 7}}),
                        m.pooled({"", NeighbourMean{}}, 192)}}};
}

FeatureLayer module_d(const Module& m) {
  return {"", Branches{{m.chain({{"branch3x3_1", 192}, {"branch3x3_2", 320, 3, 3, 2, false}}),
                        m.chain({{"branch7x7x3_1", 192},
                                 {"branch7x7x3_2", 192, 1, 7},
                                 {"branch7x7x3_3", 192, 7, 1},
                                 {"branch7x7x3_4", 192, 3, 3, 2, false}}),
                        {kHalving}}}};
}

FeatureLayer module_e(const Module& m, const FeatureLayer& pooling) {
  return {"", Branches{{m.chain({{"branch1x1", 320}}), m.ending_in_two({{"branch3x3_1", 384}}, "branch3x3_2"),
                        m.ending_in_two({{"branch3x3dbl_1", 448}, {"branch3x3dbl_2", 384, 3, 3}}, "branch3x3dbl_3"),
                        m.pooled(pooling, 192)}}};
}

/// torchvision's network has the same names but other weights and a classifier of 1000 classes: only that tells.
void need_classifier(const Weights& from) {
  const std::vector<int64_t> wanted = {1008, 2048};
  const auto at = from.tensors.find("fc.weight");
  if (at != from.tensors.end() && at->second.shape == wanted) return;
  throw Error(
      Fault::data,
      text(from.file.string(), ": looked for fc.weight ", shape_text(wanted), ", found ",
           at == from.tensors.end() ? "none" : shape_text(at->second.shape),
           ": want the Inception of 2015-12-05 with its 1008 classes, as torch-fidelity and pytorch-fid provide it, "
           "not torchvision's"));
}

Tensor lerp_rows(const Tensor& table, int64_t count) {
  const int64_t size = table.dim(0);
  const float step = static_cast<float>(size) / static_cast<float>(count);  // float32, as in TensorFlow
  std::vector<int32_t> before, after;
  std::vector<float> part;
  for (int64_t i = 0; i < count; i++) {
    const float place = static_cast<float>(i) * step;
    before.push_back(static_cast<int32_t>(std::min(static_cast<int64_t>(place), size - 1)));
    after.push_back(static_cast<int32_t>(std::min<int64_t>(before.back() + 1, size - 1)));
    part.push_back(place - static_cast<float>(before.back()));
  }
  const Tensor low = gather_rows(table, from_host(before, {count})),
               high = gather_rows(table, from_host(after, {count}));
  return low + (high - low) * from_host(part, {count, 1, 1, 1});
}

}  // namespace

Tensor resize_tensorflow1(const Tensor& x, int64_t side) {
  match("resize_tensorflow1", {{"x", x, "N C H W"}});
  const Tensor rows = lerp_rows(permute(x, {2, 0, 1, 3}), side);  // [side,N,C,W]
  return permute(lerp_rows(permute(rows, {3, 1, 2, 0}), side), {1, 2, 3, 0});
}

FeatureNetwork inception(const Weights& from) {
  need_classifier(from);
  constexpr float kScale = 255.f / 128;  // (bytes - 128) / 128
  const std::string reported = name_by_weights(kInception, is_published(kInception, from.sha256));
  FeatureNetwork net{reported, full({1, 3, 1, 1}, kScale), full({1, 3, 1, 1}, -1), {}, {}, 1, 299};
  const auto conv = [&](int64_t in, const Kernel& kernel) {
    return FeatureLayer{"", read_normalised(from, kernel.name, in, kernel)};
  };
  const auto mixed = [&](const char* name, int64_t in) { return Module{from, std::string("Mixed_") + name, in}; };
  net.layers = {conv(3, {"Conv2d_1a_3x3", 32, 3, 3, 2, false}),
                conv(32, {"Conv2d_2a_3x3", 32, 3, 3, 1, false}),
                conv(32, {"Conv2d_2b_3x3", 64, 3, 3}),
                {"pool1", kHalving.what},
                conv(64, {"Conv2d_3b_1x1", 80}),
                conv(80, {"Conv2d_4a_3x3", 192, 3, 3, 1, false}),
                {"pool2", kHalving.what},
                module_a(mixed("5b", 192), 32),
                module_a(mixed("5c", 256), 64),
                module_a(mixed("5d", 288), 64),
                module_b(mixed("6a", 288)),
                module_c(mixed("6b", 768), 128),
                module_c(mixed("6c", 768), 160),
                module_c(mixed("6d", 768), 160),
                module_c(mixed("6e", 768), 192),
                module_d(mixed("7a", 768)),
                module_e(mixed("7b", 1280), {"", NeighbourMean{}}),
                module_e(mixed("7c", 2048), {"", Pooling{3, 1, 1}})};
  net.layers[14].name = "Mixed_6e", net.layers.back().name = "Mixed_7c";
  return net;
}

}  // namespace cloam
