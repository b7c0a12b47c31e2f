// Inception with random weights against a float64 forward on the host that folds nothing, and its unusual layers alone.
#include "models/nn/inception.h"

#include <doctest/doctest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>

#include "runtime/error.h"

using namespace cloam;

namespace {

using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

struct Map {
  int64_t height, width;
  Rows values;  // [channels, height * width]
  double at(int64_t c, int64_t y, int64_t x) const { return values(c, y * width + x); }
  bool inside(int64_t y, int64_t x) const { return y >= 0 && y < height && x >= 0 && x < width; }
};

struct Convolution {
  const char* name;
  int64_t out, rows = 1, columns = 1, stride = 1, pad_rows = 0, pad_columns = 0;
};

float number(std::mt19937& random, float low, float high) {
  return low + (high - low) * static_cast<float>(random() >> 8) * 0x1p-24f;
}

NamedTensor named(const std::vector<int64_t>& shape, const std::vector<float>& values) {
  NamedTensor tensor{"F32", shape, std::vector<std::byte>(4 * values.size())};
  std::memcpy(tensor.data.data(), values.data(), tensor.data.size());
  return tensor;
}

std::vector<float> values_of(const NamedTensor& tensor) {
  std::vector<float> values(tensor.data.size() / 4);
  std::memcpy(values.data(), tensor.data.data(), tensor.data.size());
  return values;
}

/// torch-fidelity's modules by its source. A tensor that is asked for is drawn, under its name in the state, so that
/// the network read from them has to ask for the same.
struct HostInception {
  Weights weights = {"drawn", {{"fc.weight", named({1008, 2048}, std::vector<float>(1008 * 2048))}}};
  std::mt19937 random{1};
  std::string module = "";

  std::vector<float> drawn(const std::string& name, const std::vector<int64_t>& shape, float low, float high) {
    const auto found = weights.tensors.find(name);
    if (found != weights.tensors.end()) return values_of(found->second);
    int64_t count = 1;
    for (const int64_t extent : shape) count *= extent;
    std::vector<float> values(static_cast<size_t>(count));
    for (float& value : values) value = number(random, low, high);
    weights.tensors[name] = named(shape, values);
    return values;
  }

  /// BasicConv2d: convolution, batch normalisation, ReLU.
  Map conv(const Map& x, const Convolution& c) {
    const int64_t in = x.values.rows(), taps = in * c.rows * c.columns;
    const std::string name = module + c.name;
    const float bound = std::sqrt(6.f / static_cast<float>(taps));
    const std::vector<float> w = drawn(name + ".conv.weight", {c.out, in, c.rows, c.columns}, -bound, bound);
    Map y{(x.height + 2 * c.pad_rows - c.rows) / c.stride + 1,
          (x.width + 2 * c.pad_columns - c.columns) / c.stride + 1,
          {}};
    Rows seen = Rows::Zero(taps, y.height * y.width);
    for (int64_t tap = 0; tap < taps; tap++)
      for (int64_t place = 0; place < y.height * y.width; place++) {
        const int64_t row = place / y.width * c.stride + tap / c.columns % c.rows - c.pad_rows;
        const int64_t column = place % y.width * c.stride + tap % c.columns - c.pad_columns;
        if (x.inside(row, column)) seen(tap, place) = x.at(tap / (c.rows * c.columns), row, column);
      }
    using Floats = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    y.values = Eigen::Map<const Floats>(w.data(), c.out, taps).cast<double>() * seen;
    const std::vector<float> gamma = drawn(name + ".bn.weight", {c.out}, 0.5f, 1.5f);
    const std::vector<float> beta = drawn(name + ".bn.bias", {c.out}, -0.2f, 0.2f);
    const std::vector<float> mean = drawn(name + ".bn.running_mean", {c.out}, -0.2f, 0.2f);
    const std::vector<float> variance = drawn(name + ".bn.running_var", {c.out}, 0.2f, 1.8f);
    for (int64_t k = 0; k < c.out; k++) {
      const auto i = static_cast<size_t>(k);
      const auto normal = (y.values.row(k).array() - double{mean[i]}) / std::sqrt(double{variance[i]} + 0.001);
      y.values.row(k) = (normal * double{gamma[i]} + double{beta[i]}).cwiseMax(0).eval();
    }
    return y;
  }

  Map chain(Map x, const std::vector<Convolution>& convolutions) {
    for (const Convolution& c : convolutions) x = conv(x, c);
    return x;
  }
};

Map joined(const std::vector<Map>& maps) {
  Map all{maps[0].height, maps[0].width, {}};
  for (const Map& map : maps) {
    REQUIRE(map.values.cols() == maps[0].values.cols());
    Rows both(all.values.rows() + map.values.rows(), map.values.cols());
    if (all.values.rows() > 0) both.topRows(all.values.rows()) = all.values;
    both.bottomRows(map.values.rows()) = map.values;
    all.values = both;
  }
  return all;
}

/// Windows of 3x3 of which what is outside does not count: their largest value, or their mean.
Map pooled(const Map& x, int64_t stride, int64_t pad, bool largest) {
  Map y{(x.height + 2 * pad - 3) / stride + 1, (x.width + 2 * pad - 3) / stride + 1, {}};
  y.values.resize(x.values.rows(), y.height * y.width);
  for (int64_t c = 0; c < x.values.rows(); c++)
    for (int64_t place = 0; place < y.values.cols(); place++) {
      double best = -1e30, sum = 0;
      int count = 0;
      for (int64_t tap = 0; tap < 9; tap++) {
        const int64_t row = place / y.width * stride + tap / 3 - pad, column = place % y.width * stride + tap % 3 - pad;
        if (!x.inside(row, column)) continue;
        best = std::max(best, x.at(c, row, column));
        sum += x.at(c, row, column);
        count++;
      }
      y.values(c, place) = largest ? best : sum / count;
    }
  return y;
}

Map halved(const Map& x) { return pooled(x, 2, 0, true); }
Map neighbours_mean(const Map& x) { return pooled(x, 1, 1, false); }

Map module_a(HostInception& net, const Map& x, int64_t features) {
  return joined(
      {net.conv(x, {"branch1x1", 64}), net.chain(x, {{"branch5x5_1", 48}, {"branch5x5_2", 64, 5, 5, 1, 2, 2}}),
       net.chain(
           x, {{"branch3x3dbl_1", 64}, {"branch3x3dbl_2", 96, 3, 3, 1, 1, 1}, {"branch3x3dbl_3", 96, 3, 3, 1, 1, 1}}),
       net.conv(neighbours_mean(x), {"branch_pool", features})});
}

Map module_b(HostInception& net, const Map& x) {
  return joined(
      {net.conv(x, {"branch3x3", 384, 3, 3, 2}),
       net.chain(x, {{"branch3x3dbl_1", 64}, {"branch3x3dbl_2", 96, 3, 3, 1, 1, 1}, {"branch3x3dbl_3", 96, 3, 3, 2}}),
       halved(x)});
}

Map module_c(HostInception& net, const Map& x, int64_t c7) {
  return joined(
      {net.conv(x, {"branch1x1", 192}),
       net.chain(x, {{"branch7x7_1", c7}, {"branch7x7_2", c7, 1, 7, 1, 0, 3}, {"branch7x7_3", 192, 7, 1, 1, 3, 0}}),
       net.chain(x, {{"branch7x7dbl_1", c7},
                     {"branch7x7dbl_2", c7, 7, 1, 1, 3, 0},
                     {"branch7x7dbl_3", c7, 1, 7, 1, 0, 3},
                     {"branch7x7dbl_4", c7, 7, 1, 1, 3, 0},
                     {"branch7x7dbl_5", 192, 1, 7, 1, 0, 3}}),
       net.conv(neighbours_mean(x), {"branch_pool", 192})});
}

Map module_d(HostInception& net, const Map& x) {
  return joined({net.chain(x, {{"branch3x3_1", 192}, {"branch3x3_2", 320, 3, 3, 2}}),
                 net.chain(x, {{"branch7x7x3_1", 192},
                               {"branch7x7x3_2", 192, 1, 7, 1, 0, 3},
                               {"branch7x7x3_3", 192, 7, 1, 1, 3, 0},
                               {"branch7x7x3_4", 192, 3, 3, 2}}),
                 halved(x)});
}

Map module_e(HostInception& net, const Map& x, bool largest) {
  const Map b3 = net.conv(x, {"branch3x3_1", 384});
  const Map dbl = net.chain(x, {{"branch3x3dbl_1", 448}, {"branch3x3dbl_2", 384, 3, 3, 1, 1, 1}});
  return joined({net.conv(x, {"branch1x1", 320}), net.conv(b3, {"branch3x3_2a", 384, 1, 3, 1, 0, 1}),
                 net.conv(b3, {"branch3x3_2b", 384, 3, 1, 1, 1, 0}),
                 net.conv(dbl, {"branch3x3dbl_3a", 384, 1, 3, 1, 0, 1}),
                 net.conv(dbl, {"branch3x3dbl_3b", 384, 3, 1, 1, 1, 0}),
                 net.conv(pooled(x, 1, 1, largest), {"branch_pool", 192})});
}

/// Up to the first pooling: bytes / 255 in.
Map stem(HostInception& net, Map x) {
  x.values = (255 * x.values.array() - 128) / 128;
  net.module = "";
  return halved(net.chain(
      x, {{"Conv2d_1a_3x3", 32, 3, 3, 2}, {"Conv2d_2a_3x3", 32, 3, 3}, {"Conv2d_2b_3x3", 64, 3, 3, 1, 1, 1}}));
}

/// The four taps.
std::vector<Map> forward(HostInception& net, const Map& image) {
  std::vector<Map> taps = {stem(net, image)};
  Map x = halved(net.chain(taps[0], {{"Conv2d_3b_1x1", 80}, {"Conv2d_4a_3x3", 192, 3, 3}}));
  taps.push_back(x);
  for (const auto& [name, features] : {std::pair("5b", 32), std::pair("5c", 64), std::pair("5d", 64)})
    net.module = std::string("Mixed_") + name + ".", x = module_a(net, x, features);
  net.module = "Mixed_6a.", x = module_b(net, x);
  for (const auto& [name, c7] :
       {std::pair("6b", 128), std::pair("6c", 160), std::pair("6d", 160), std::pair("6e", 192)})
    net.module = std::string("Mixed_") + name + ".", x = module_c(net, x, c7);
  taps.push_back(x);
  net.module = "Mixed_7a.", x = module_d(net, x);
  net.module = "Mixed_7b.", x = module_e(net, x, false);
  net.module = "Mixed_7c.", x = module_e(net, x, true);
  taps.push_back(x);
  return taps;
}

Map noise(int64_t channels, int64_t height, int64_t width) {
  std::mt19937 random(7);
  Map map{height, width, Rows(channels, height * width)};
  for (int64_t i = 0; i < map.values.size(); i++) map.values.data()[i] = static_cast<double>(random() % 256) / 255;
  return map;
}

Tensor tensor_of(const Map& map) {
  std::vector<float> values(static_cast<size_t>(map.values.size()));
  for (size_t i = 0; i < values.size(); i++) values[i] = static_cast<float>(map.values.data()[i]);
  return from_host(values, {1, map.values.rows(), map.height, map.width});
}

/// The largest difference, as a part of the largest value.
double difference(const Tensor& found, const Map& want) {
  REQUIRE(found.shape() == Shape{1, want.values.rows(), want.height, want.width});
  const std::vector<float> values = found.to_host();
  double worst = 0;
  for (size_t i = 0; i < values.size(); i++)
    worst = std::max(worst, std::abs(double{values[i]} - want.values.data()[i]));
  return worst / want.values.cwiseAbs().maxCoeff();
}

/// TensorFlow's half_pixel_centers=false: an output pixel looks at its number times the ratio of sizes.
Map scaled(const Map& x, int64_t side) {
  Map y{side, side, Rows(x.values.rows(), side * side)};
  for (int64_t c = 0; c < x.values.rows(); c++)
    for (int64_t place = 0; place < side * side; place++) {
      const double row = static_cast<double>(place / side * x.height) / static_cast<double>(side);
      const double column = static_cast<double>(place % side * x.width) / static_cast<double>(side);
      const auto top = static_cast<int64_t>(row), left = static_cast<int64_t>(column);
      const int64_t bottom = std::min(top + 1, x.height - 1), right = std::min(left + 1, x.width - 1);
      const double down = row - static_cast<double>(top), across = column - static_cast<double>(left);
      y.values(c, place) = (1 - down) * ((1 - across) * x.at(c, top, left) + across * x.at(c, top, right)) +
                           down * ((1 - across) * x.at(c, bottom, left) + across * x.at(c, bottom, right));
    }
  return y;
}

}  // namespace

TEST_CASE("TensorFlow 1's bilinear scaling, up and down, against float64") {
  for (const auto& [height, width] : {std::pair(5, 7), std::pair(31, 12), std::pair(1, 9)}) {
    const Map image = noise(2, height, width);
    CHECK(difference(resize_tensorflow1(tensor_of(image), 9), scaled(image, 9)) < 1e-6);
  }
}

TEST_CASE("the mean of neighbours leaves out what is outside of the image") {
  const Map image = noise(3, 4, 5);
  CHECK(difference(NeighbourMean{}(tensor_of(image)), neighbours_mean(image)) < 1e-6);
  CHECK(NeighbourMean{}(full({1, 1, 1, 2}, 3)).to_host() == std::vector<float>{3, 3});
}

TEST_CASE(
    "Inception is torch-fidelity's network: weights by its names, values of a float64 forward that folds nothing") {
  // 107 x 75 pixels are 2 x 1 places in the end, where means and maxima differ; the padding is everywhere.
  const Map image = noise(3, 107, 75);
  HostInception host;
  const std::vector<Map> want = forward(host, image);
  size_t convolutions = 0;
  int64_t weights = 0, channels = 0;  // published: 21,802,784 without the classifier, of which 3 of 17,216 channels
  for (const auto& [name, tensor] : host.weights.tensors) {
    if (name.ends_with(".conv.weight")) convolutions++, weights += static_cast<int64_t>(tensor.data.size() / 4);
    if (name.ends_with(".bn.bias")) channels += tensor.shape[0];
  }
  CHECK(convolutions == 94);
  CHECK(weights + 3 * channels == 21802784);
  CHECK(channels == 17216);

  FeatureNetwork net = feature_network(host.weights);
  CHECK(net.name == "inception-v3-2015-12-05, unverified weights");  // which are not FID's: drawn
  host.weights.sha256 = "6726825d0af5f729cebd5821db510b11b1cfad8faad88a03f1befd49fb9129b2";
  CHECK(feature_network(host.weights).name == "inception-v3-2015-12-05");
  CHECK(net.side == 299);
  net.side = 0;
  const Tensors taps = net(tensor_of(image));
  REQUIRE(taps.size() == 4);
  for (size_t t = 0; t < taps.size(); t++) CHECK(difference(taps[t], want[t]) < 2e-5);
  CHECK(taps[3].shape() == Shape{1, 2048, 2, 1});

  net.side = 75;
  const Map other = noise(3, 60, 100);
  HostInception again = host;
  CHECK(difference(net(tensor_of(other))[0], stem(again, scaled(other, 75))) < 2e-5);
  CHECK_THROWS_WITH_AS(perceptual_loss(net, tensor_of(other), tensor_of(other)), doctest::Contains("SqueezeNet or VGG"),
                       Error);

  const auto refused = [&](const std::string& message) {
    CHECK_THROWS_WITH_AS(feature_network(host.weights), doctest::Contains(message.c_str()), Error);
  };
  TensorMap& all = host.weights.tensors;
  all["Conv2d_2a_3x3.bn.running_var"] = named({32}, std::vector<float>(32, -1));
  refused("Conv2d_2a_3x3.bn.running_var has a value below 0");
  auto node = all.extract("Conv2d_1a_3x3.bn.running_mean");
  node.key() = "Conv2d_1a_3x3.bn.mean";
  all.insert(std::move(node));
  refused("looked for Conv2d_1a_3x3.bn.running_mean F32 [32], found Conv2d_1a_3x3.bn.bias F32 [32]");
  all["Conv2d_1a_3x3.conv.weight"].shape = {32, 3, 9, 1};
  refused("looked for Conv2d_1a_3x3.conv.weight F32 [32,3,3,3], found F32 [32,3,9,1]");
  all["fc.weight"] = named({1000, 2048}, std::vector<float>(1000 * 2048));
  refused("found [1000,2048]: want the Inception of 2015-12-05");
  all.erase("fc.weight");
  refused("looked for fc.weight [1008,2048], found none");
}
