// The networks' tables: names and shapes of their weights, what they want images to be, which layers are looked at.
#include "models/nn/feature_network.h"

#include <algorithm>
#include <cmath>

#include "models/io/weights.h"
#include "models/nn/params.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Convolution = FeatureLayer::Convolution;

Tensor each_channel(const std::vector<float>& values) { return from_host(values, {1, 3, 1, 1}); }

Convolution read(const Weights& from, const std::string& name, const Shape& shape, Conv2dParams with) {
  const auto values = from.take(name + ".weight", {shape.begin(), shape.end()});
  return {from_host(values, shape), from_host(from.take(name + ".bias", {shape[0]}), {shape[0]}), with};
}

constexpr const char* kSqueezeNetFirst = "conv1";
constexpr const char* kVggFirst = "features.0";

/// Names as in SqueezeNet_deploy.prototxt. A module's `in` channels become twice `expand`.
FeatureLayer fire(const Weights& from, const std::string& name, int64_t in, int64_t squeeze, int64_t expand) {
  return {"",
          {read(from, name + "/conv1x1_1", {squeeze, in, 1, 1}, {}),
           read(from, name + "/conv1x1_2", {expand, squeeze, 1, 1}, {}),
           read(from, name + "/conv3x3_2", {expand, squeeze, 3, 3}, {.pad = 1})}};
}

/// It was trained on BGR: the filters of its first layer are turned round, not every image.
Convolution for_rgb(const Convolution& bgr) {
  const Tensor planes = bgr.weight;
  return {concat({slice(planes, 1, 2, 3), slice(planes, 1, 1, 2), slice(planes, 1, 0, 1)}, 1), bgr.bias, bgr.with};
}

/// SqueezeNet v1.0 up to its last fire module. Caffe's images: 0 to 255, less the mean colour.
FeatureNetwork squeezenet(const Weights& from) {
  constexpr Pooling kPool = {3, 2, 0, true};
  FeatureNetwork net{"squeezenet-1.0", each_channel({255, 255, 255}), each_channel({-123, -117, -104}), {}, {}, 29};
  net.layers = {{"", {for_rgb(read(from, kSqueezeNetFirst, {96, 3, 7, 7}, {.stride = 2}))}},
                {"", {}, kPool},
                fire(from, "fire2", 96, 16, 64),
                fire(from, "fire3", 128, 16, 64),
                fire(from, "fire4", 128, 32, 128),
                {"", {}, kPool},
                fire(from, "fire5", 256, 32, 128),
                fire(from, "fire6", 256, 48, 192),
                fire(from, "fire7", 384, 48, 192),
                fire(from, "fire8", 384, 64, 256),
                {"", {}, kPool},
                fire(from, "fire9", 512, 64, 256)};
  net.layers[0].name = "conv1", net.layers[3].name = "fire3", net.layers[6].name = "fire5";
  net.layers[11].name = "fire9";
  net.loss_weights = {1 / (3 * 14.f), 1 / (3 * 120.f), 1 / (3 * 150.f), 0};
  return net;
}

/// VGG-19 up to relu5_1, torchvision's names (the number is the layer's place among convolutions, ReLUs and poolings)
/// and images.
FeatureNetwork vgg19(const Weights& from) {
  constexpr std::array<float, 3> kMean = {0.485f, 0.456f, 0.406f}, kDeviation = {0.229f, 0.224f, 0.225f};
  std::vector<float> scale, shift;
  for (size_t c = 0; c < 3; c++) scale.push_back(1 / kDeviation[c]), shift.push_back(-kMean[c] / kDeviation[c]);
  FeatureNetwork net{"vgg-19", each_channel(scale), each_channel(shift), {}, {}, 16};
  struct Block {
    int64_t channels;
    int convolutions;
  };
  int64_t in = 3, place = 0, block_number = 0;
  for (const Block block : {Block{64, 2}, Block{128, 2}, Block{256, 4}, Block{512, 4}, Block{512, 1}}) {
    if (block_number++ > 0) net.layers.push_back({}), place++;
    for (int i = 0; i < block.convolutions; i++, place += 2, in = block.channels)
      net.layers.push_back({i == 0 ? text("relu", block_number, "_1") : "",
                            {read(from, text("features.", place), {block.channels, in, 3, 3}, {.pad = 1})}});
  }
  net.loss_weights = {1 / 32.f, 1 / 16.f, 1 / 8.f, 1 / 4.f, 1};
  return net;
}

Tensor features_difference(const Tensor& a, const Tensor& b) { return mean(abs(a - stop_gradient(b))); }

}  // namespace

FeatureNetwork random_features() {
  FeatureNetwork net{"random features", each_channel({4, 4, 4}), each_channel({-2, -2, -2}), {}, {}, 8};
  Params drawn;
  int64_t in = 3;
  for (const int64_t out : {16, 32, 64, 64}) {
    if (in > 3) net.layers.push_back({});
    const Shape shape{out, in, 3, 3};
    const std::string name = text("stage", drawn.size() + 1);
    const Tensor weight = Scope{drawn, "", 1}.uniform(name, shape, std::sqrt(6.f / static_cast<float>(9 * in)));
    net.layers.push_back({name, {{from_host(weight.to_host(), shape), zeros({out}), {.pad = 1}}}});
    in = out;
  }
  net.loss_weights = {1 / (4 * 0.5f), 1 / (4 * 0.33f), 1 / (4 * 0.55f), 1 / (4 * 0.88f)};
  return net;
}

FeatureNetwork feature_network(const std::filesystem::path& path) {
  if (path.empty()) return random_features();
  const Weights weights = read_weights(path);
  const auto begins = [&](const std::string& first) { return weights.has(first + ".weight"); };
  if (begins(kSqueezeNetFirst)) return squeezenet(weights);
  if (begins(kVggFirst)) return vgg19(weights);
  throw Error(Fault::data, text(weights.file.string(), ": looked for ", kSqueezeNetFirst,
                                ".weight [96,3,7,7] (SqueezeNet v1.0, Caffe's names) or ", kVggFirst,
                                ".weight [64,3,3,3] (VGG-19, torchvision's names), found ", weights.content()));
}

Tensor FeatureLayer::operator()(const Tensor& x) const {
  const auto through = [&](size_t i, const Tensor& from) {
    const Convolution& c = convolutions[i];
    return conv2d(from, c.weight, c.with, {.bias = c.bias, .activation = Activation::relu});
  };
  if (convolutions.empty()) return max_pool2d(x, pooling);
  const Tensor first = through(0, x);
  return convolutions.size() == 1 ? first : concat({through(1, first), through(2, first)}, 1);
}

Tensors FeatureNetwork::operator()(const Tensor& images) const {
  const Dims d = match("feature_network", {{"images", images, "N 3 H W"}});
  if (std::min(d["H"], d["W"]) < smallest)
    throw Error(Fault::internal, text("[feature_network] images ", to_string(images.shape()), ", ", name, " wants ",
                                      smallest, " pixels a side at least"));
  Tensors taps;
  Tensor x = images * scale + shift;
  for (const FeatureLayer& layer : layers) {
    x = layer(x);
    if (!layer.name.empty()) taps.push_back(x);
  }
  return taps;
}

Tensor perceptual_loss(const FeatureNetwork& network, const Tensor& rendered, const Tensor& truth) {
  match("perceptual_loss", {{"rendered", rendered, "N 3 H W"}, {"truth", truth, "N 3 H W"}});
  const Tensors ours = network(rendered), wanted = network(stop_gradient(truth));
  Tensor loss = 0.f;
  for (size_t i = 0; i < ours.size(); i++)
    if (network.loss_weights[i] > 0) loss = loss + network.loss_weights[i] * features_difference(ours[i], wanted[i]);
  return loss;
}

}  // namespace cloam
