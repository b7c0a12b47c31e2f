// The networks' tables: names and shapes of their weights, what they want images to be, which layers are looked at.
#include "models/nn/feature_network.h"

#include <algorithm>
#include <cmath>

#include "models/nn/inception.h"
#include "models/nn/params.h"
#include "runtime/error.h"

namespace cloam {
namespace {

Tensor each_channel(const std::vector<float>& values) { return from_host(values, {1, 3, 1, 1}); }

FeatureConvolution read(const Weights& from, const std::string& name, const Shape& shape) {
  const auto values = from.take(name + ".weight", {shape.begin(), shape.end()});
  return {from_host(values, shape), from_host(from.take(name + ".bias", {shape[0]}), {shape[0]})};
}

constexpr const char* kSqueezeNetFirst = "conv1";
constexpr const char* kTorchvisionFirst = "features.0";
constexpr const char* kOfVgg16Alone = "features.17";  // VGG-19 has a ReLU there

/// It was trained on BGR: the filters of its first layer are turned round, not every image.
FeatureConvolution first_of_squeezenet(const Weights& from) {
  const FeatureConvolution bgr = read(from, kSqueezeNetFirst, {96, 3, 7, 7});
  const Tensor planes = bgr.weight;
  return {concat({slice(planes, 1, 2, 3), slice(planes, 1, 1, 2), slice(planes, 1, 0, 1)}, 1), bgr.bias, 2, 0};
}

/// SqueezeNet v1.0 up to its last fire module (Iandola et al. 2016): 1x1, then 1x1 and 3x3 side by side. Names as in
/// SqueezeNet_deploy.prototxt. Caffe's images: 0 to 255, less the mean colour.
FeatureNetwork squeezenet(const Weights& from) {
  constexpr Pooling kPool = {3, 2, 0, true};
  FeatureNetwork net{"squeezenet-1.0", each_channel({255, 255, 255}), each_channel({-123, -117, -104}), {}, {}, 29};
  const auto fire = [&](const std::string& module, int64_t in, int64_t squeeze, int64_t expand,
                        const std::string& tap = "") {
    net.layers.push_back({"", read(from, module + "/conv1x1_1", {squeeze, in, 1, 1})});
    net.layers.push_back({tap, Branches{{{{"", read(from, module + "/conv1x1_2", {expand, squeeze, 1, 1})}},
                                         {{"", read(from, module + "/conv3x3_2", {expand, squeeze, 3, 3})}}}}});
  };
  net.layers = {{"conv1", first_of_squeezenet(from)}, {"", kPool}};
  fire("fire2", 96, 16, 64);
  fire("fire3", 128, 16, 64, "fire3");
  fire("fire4", 128, 32, 128);
  net.layers.push_back({"", kPool});
  fire("fire5", 256, 32, 128, "fire5");
  fire("fire6", 256, 48, 192);
  fire("fire7", 384, 48, 192);
  fire("fire8", 384, 64, 256);
  net.layers.push_back({"", kPool});
  fire("fire9", 512, 64, 256, "fire9");
  net.loss_weights = {1 / (3 * 14.f), 1 / (3 * 120.f), 1 / (3 * 150.f), 0};
  return net;
}

/// torchvision's images: less the mean colour of ImageNet, by its deviation. LPIPS's shift and scale are the same for
/// images from -1 to 1.
FeatureNetwork of_torchvision(const std::string& name, int64_t smallest) {
  constexpr std::array<float, 3> kMean = {0.485f, 0.456f, 0.406f}, kDeviation = {0.229f, 0.224f, 0.225f};
  std::vector<float> scale, shift;
  for (size_t c = 0; c < 3; c++) scale.push_back(1 / kDeviation[c]), shift.push_back(-kMean[c] / kDeviation[c]);
  return {name, each_channel(scale), each_channel(shift), {}, {}, smallest};
}

struct Block {
  int64_t channels;
  int convolutions, tap;  // of which this one's ReLU is looked at
};

/// torchvision's names: the number is the layer's place among convolutions, ReLUs and poolings.
FeatureNetwork vgg(const Weights& from, const std::string& name, const std::vector<Block>& blocks) {
  FeatureNetwork net = of_torchvision(name, 16);
  int64_t in = 3, place = 0, block_number = 0;
  for (const Block& block : blocks) {
    if (block_number++ > 0) net.layers.push_back({}), place++;
    for (int i = 0; i < block.convolutions; i++, place += 2, in = block.channels)
      net.layers.push_back({i == block.tap ? text("relu", block_number, "_", i + 1) : "",
                            read(from, text("features.", place), {block.channels, in, 3, 3})});
  }
  return net;
}

/// Up to relu5_1.
FeatureNetwork vgg19(const Weights& from) {
  FeatureNetwork net = vgg(from, "vgg-19", {{64, 2, 0}, {128, 2, 0}, {256, 4, 0}, {512, 4, 0}, {512, 1, 0}});
  net.loss_weights = {1 / 32.f, 1 / 16.f, 1 / 8.f, 1 / 4.f, 1};
  return net;
}

/// Up to relu5_3, as LPIPS looks at it.
FeatureNetwork vgg16(const Weights& from) {
  return vgg(from, kVgg16, {{64, 2, 1}, {128, 2, 1}, {256, 3, 2}, {512, 3, 2}, {512, 3, 2}});
}

/// AlexNet (Krizhevsky 2014, "one weird trick") up to its last convolution.
FeatureNetwork alexnet(const Weights& from) {
  constexpr Pooling kPool = {3, 2};
  FeatureNetwork net = of_torchvision(kAlexNet, 31);
  FeatureConvolution first = read(from, kTorchvisionFirst, {64, 3, 11, 11});
  first.stride = 4, first.pad = 2;
  net.layers = {{"relu1", first},
                {"", kPool},
                {"relu2", read(from, "features.3", {192, 64, 5, 5})},
                {"", kPool},
                {"relu3", read(from, "features.6", {384, 192, 3, 3})},
                {"relu4", read(from, "features.8", {256, 384, 3, 3})},
                {"relu5", read(from, "features.10", {256, 256, 3, 3})}};
  return net;
}

/// Which of torchvision's networks, all of whose layers have the same names.
FeatureNetwork torchvision_network(const Weights& from) {
  const auto& first = from.tensors.at(std::string(kTorchvisionFirst) + ".weight").shape;
  if (!first.empty() && first.back() == 11) return alexnet(from);
  return from.has(std::string(kOfVgg16Alone) + ".weight") ? vgg16(from) : vgg19(from);
}

/// x plus its two neighbours along an axis, zero outside.
Tensor sum_of_three(const Tensor& x, int axis) {
  const int64_t size = x.dim(axis);
  const Tensor wide = pad(x, axis, 1, 1);
  return slice(wide, axis, 0, size) + slice(wide, axis, 1, size + 1) + slice(wide, axis, 2, size + 2);
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
    net.layers.push_back({name, FeatureConvolution{from_host(weight.to_host(), shape), zeros({out})}});
    in = out;
  }
  net.loss_weights = {1 / (4 * 0.5f), 1 / (4 * 0.33f), 1 / (4 * 0.55f), 1 / (4 * 0.88f)};
  return net;
}

FeatureNetwork feature_network(const std::filesystem::path& path) {
  return path.empty() ? random_features() : feature_network(read_weights(path));
}

FeatureNetwork features_named(const std::string& features) {
  return feature_network(features == "random" ? "" : features);
}

FeatureNetwork feature_network(const Weights& weights) {
  const auto begins = [&](const std::string& first) { return weights.has(first + ".weight"); };
  if (begins(kSqueezeNetFirst)) return squeezenet(weights);
  if (begins(kTorchvisionFirst)) return torchvision_network(weights);
  if (begins(kInceptionFirst)) return inception(weights);
  throw Error(Fault::data, text(weights.file.string(), ": looked for ", kSqueezeNetFirst,
                                ".weight [96,3,7,7] (SqueezeNet v1.0, Caffe's names), ", kTorchvisionFirst,
                                ".weight (VGG-16, VGG-19 or AlexNet, torchvision's names) or ", kInceptionFirst,
                                ".weight [32,3,3,3] (Inception, torch-fidelity's names), found ", weights.content()));
}

// conv2d pads all sides alike: for kernels that are not square, the images are.
Tensor FeatureConvolution::operator()(const Tensor& x) const {
  const int64_t rows = pad == kHalfKernel ? weight.dim(2) / 2 : pad,
                columns = pad == kHalfKernel ? weight.dim(3) / 2 : pad;
  const Epilogue end = {.bias = bias, .activation = Activation::relu};
  if (rows == columns) return conv2d(x, weight, {stride, static_cast<int>(rows)}, end);
  return conv2d(cloam::pad(cloam::pad(x, 2, rows, rows), 3, columns, columns), weight, {stride}, end);
}

Tensor NeighbourMean::operator()(const Tensor& x) const {
  const auto sum_of_nine = [](const Tensor& of) { return sum_of_three(sum_of_three(of, 2), 3); };
  return sum_of_nine(x) / sum_of_nine(ones({1, 1, x.dim(2), x.dim(3)}));
}

Tensor Branches::operator()(const Tensor& x) const {
  Tensors results;
  for (const auto& chain : chains) {
    results.push_back(x);
    for (const FeatureLayer& layer : chain) results.back() = layer(results.back());
  }
  return concat(results, 1);
}

Tensor FeatureLayer::operator()(const Tensor& x) const {
  if (const auto* pooling = std::get_if<Pooling>(&what)) return max_pool2d(x, *pooling);
  if (const auto* convolution = std::get_if<FeatureConvolution>(&what)) return (*convolution)(x);
  if (const auto* branches = std::get_if<Branches>(&what)) return (*branches)(x);
  return std::get<NeighbourMean>(what)(x);
}

Tensors FeatureNetwork::operator()(const Tensor& images) const {
  const Dims d = match("feature_network", {{"images", images, "N 3 H W"}});
  if (std::min(d["H"], d["W"]) < smallest)
    throw Error(Fault::internal, text("[feature_network] images ", to_string(images.shape()), ", ", name, " wants ",
                                      smallest, " pixels per side or more"));
  Tensors taps;
  Tensor x = (side > 0 ? resize_tensorflow1(images, side) : images) * scale + shift;
  for (const FeatureLayer& layer : layers) {
    x = layer(x);
    if (!layer.name.empty()) taps.push_back(x);
  }
  return taps;
}

Tensor perceptual_loss(const FeatureNetwork& network, const Tensor& rendered, const Tensor& truth) {
  match("perceptual_loss", {{"rendered", rendered, "N 3 H W"}, {"truth", truth, "N 3 H W"}});
  if (network.loss_weights.empty())
    throw Error(Fault::usage, network.name + " is for metrics only: for a loss, name SqueezeNet or VGG-19 weights");
  const Tensors ours = network(rendered), wanted = network(stop_gradient(truth));
  Tensor loss = 0.f;
  for (size_t i = 0; i < ours.size(); i++)
    if (network.loss_weights[i] > 0) loss = loss + network.loss_weights[i] * features_difference(ours[i], wanted[i]);
  return loss;
}

}  // namespace cloam
