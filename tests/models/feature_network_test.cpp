// Feature networks against plain loops in float64, against what a pretrained one is known to see, and the loss against
// central differences of those loops.
#include "models/nn/feature_network.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <random>

#include "models/io/image.h"
#include "models/io/weights.h"
#include "runtime/error.h"
#include "tests/models/folder.h"

using namespace cloam;

namespace {

namespace fs = std::filesystem;

struct Map {
  int64_t channels, height, width;
  std::vector<double> values;
  double at(int64_t c, int64_t y, int64_t x) const {
    if (y < 0 || y >= height || x < 0 || x >= width) return 0;
    return values[static_cast<size_t>((c * height + y) * width + x)];
  }
};

Map empty_map(int64_t c, int64_t h, int64_t w) {
  return {c, h, w, std::vector<double>(static_cast<size_t>(c * h * w))};
}

struct HostConvolution {
  std::vector<float> weight, bias;
  int64_t out, side;
  int stride = 1, pad = 0;
};

/// ReLU(convolution).
Map convolved(const Map& x, const HostConvolution& of) {
  Map y = empty_map(of.out, (x.height + 2 * of.pad - of.side) / of.stride + 1,
                    (x.width + 2 * of.pad - of.side) / of.stride + 1);
  size_t i = 0;
  for (int64_t k = 0; k < y.channels; k++)
    for (int64_t p = 0; p < y.height; p++)
      for (int64_t q = 0; q < y.width; q++, i++) {
        double sum = double{of.bias[static_cast<size_t>(k)]};
        size_t w = static_cast<size_t>(k * x.channels * of.side * of.side);
        for (int64_t c = 0; c < x.channels; c++)
          for (int64_t r = 0; r < of.side; r++)
            for (int64_t s = 0; s < of.side; s++)
              sum += double{of.weight[w++]} * x.at(c, p * of.stride + r - of.pad, q * of.stride + s - of.pad);
        y.values[i] = std::max(sum, 0.0);
      }
  return y;
}

Map pooled(const Map& x, int64_t window, int64_t rows, int64_t columns) {
  Map y = empty_map(x.channels, rows, columns);
  size_t i = 0;
  for (int64_t c = 0; c < y.channels; c++)
    for (int64_t p = 0; p < y.height; p++)
      for (int64_t q = 0; q < y.width; q++, i++) {
        double best = -std::numeric_limits<double>::infinity();
        for (int64_t r = 2 * p; r < std::min(x.height, 2 * p + window); r++)
          for (int64_t s = 2 * q; s < std::min(x.width, 2 * q + window); s++) best = std::max(best, x.at(c, r, s));
        y.values[i] = best;
      }
  return y;
}

Map joined(Map a, const Map& b) {
  a.channels += b.channels;
  a.values.insert(a.values.end(), b.values.begin(), b.values.end());
  return a;
}

std::vector<float> noise(size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<float> values(count);
  for (float& value : values) value = static_cast<float>(random() % 4096) / 4095.f;
  return values;
}

double worst_difference(const Tensor& found, const Map& want) {
  REQUIRE(found.shape() == Shape{1, want.channels, want.height, want.width});
  const std::vector<float> values = found.to_host();
  double worst = 0, largest = 0;
  for (size_t i = 0; i < values.size(); i++) {
    worst = std::max(worst, std::abs(double{values[i]} - want.values[i]));
    largest = std::max(largest, std::abs(want.values[i]));
  }
  return worst / largest;
}

/// random_features() written again, with its weights.
std::vector<Map> random_taps(const FeatureNetwork& net, const std::vector<double>& image, int64_t side) {
  Map x = {3, side, side, image};
  for (double& value : x.values) value = 4 * value - 2;
  std::vector<Map> taps;
  for (size_t stage = 0; stage < 4; stage++) {
    if (stage > 0) x = pooled(x, 2, x.height / 2, x.width / 2);
    const auto& c = std::get<FeatureConvolution>(net.layers[2 * stage].what);
    x = convolved(x, {c.weight.to_host(), c.bias.to_host(), c.weight.dim(0), 3, 1, 1});
    taps.push_back(x);
  }
  return taps;
}

double random_loss(const FeatureNetwork& net, const std::vector<double>& a, const std::vector<double>& b,
                   int64_t side) {
  const std::vector<Map> ours = random_taps(net, a, side), wanted = random_taps(net, b, side);
  double loss = 0;
  for (size_t t = 0; t < ours.size(); t++) {
    double sum = 0;
    for (size_t i = 0; i < ours[t].values.size(); i++) sum += std::abs(ours[t].values[i] - wanted[t].values[i]);
    loss += double{net.loss_weights[t]} * sum / static_cast<double>(ours[t].values.size());
  }
  return loss;
}

/// The SqueezeNet of the test data, or an empty path.
fs::path squeezenet_folder() {
  const fs::path folder = test_data("squeezenet_v1.0_deepcompressed");
  return no_data(folder) ? fs::path() : folder;
}

std::vector<double> doubles(const std::vector<float>& values) { return {values.begin(), values.end()}; }

}  // namespace

TEST_CASE("random features are a small network of fixed weights") {
  const FeatureNetwork net = feature_network("");
  CHECK(net.name == "random features");
  const std::vector<float> image = noise(3 * 11 * 11, 1);
  const Tensors taps = net(from_host(image, {1, 3, 11, 11}));
  const std::vector<Map> want = random_taps(net, doubles(image), 11);
  REQUIRE(taps.size() == want.size());
  REQUIRE(net.loss_weights.size() == want.size());
  for (size_t t = 0; t < taps.size(); t++) CHECK(worst_difference(taps[t], want[t]) < 1e-5);
  const FeatureNetwork again = random_features();
  const auto weights = [](const FeatureNetwork& of) {
    return std::get<FeatureConvolution>(of.layers[2].what).weight.to_host();
  };
  CHECK(weights(again) == weights(net));
  CHECK_THROWS_WITH_AS(net(zeros({1, 3, 7, 9})), doctest::Contains("8 pixels per side"), Error);
}

TEST_CASE("the perceptual loss and its gradient against central differences in float64") {
  constexpr int64_t kSide = 9;
  const FeatureNetwork net = random_features();
  const std::vector<float> a = noise(3 * kSide * kSide, 1), b = noise(3 * kSide * kSide, 2);
  const Shape shape{1, 3, kSide, kSide};
  const Tensor rendered = parameter(a, shape), truth = parameter(b, shape);
  const Tensor loss = perceptual_loss(net, rendered, truth);
  CHECK(loss.item() == doctest::Approx(random_loss(net, doubles(a), doubles(b), kSide)).epsilon(1e-5));
  const Tensors gradients = grad(loss, {rendered, truth});
  const std::vector<float> found = gradients[0].to_host();
  for (size_t i = 0; i < found.size(); i += 7) {
    std::vector<double> more = doubles(a), less = more;
    more[i] += 1e-6, less[i] -= 1e-6;
    const double want = (random_loss(net, more, doubles(b), kSide) - random_loss(net, less, doubles(b), kSide)) / 2e-6;
    CHECK(std::abs(double{found[i]} - want) < 1e-5 + 1e-3 * std::abs(want));
  }
  const std::vector<float> none = gradients[1].to_host();
  CHECK(std::all_of(none.begin(), none.end(), [](float value) { return value == 0; }));
  CHECK(perceptual_loss(net, truth, truth).item() == 0);
}

TEST_CASE("SqueezeNet's first layers against float64, with the data's weights") {
  const fs::path folder = squeezenet_folder();
  if (folder.empty()) return;
  const FeatureNetwork net = feature_network(folder);
  CHECK(net.name == "squeezenet-1.0");
  constexpr int64_t kSide = 31;
  const std::vector<float> image = noise(3 * kSide * kSide, 1);
  const Tensors taps = net(from_host(image, {1, 3, kSide, kSide}));
  REQUIRE(taps.size() == net.loss_weights.size());
  // As the data's README says: blue first, 0 to 255, less (104,117,123).
  Map x = empty_map(3, kSide, kSide);
  constexpr double kMean[] = {104, 117, 123};
  for (size_t c = 0; c < 3; c++)
    for (size_t i = 0; i < kSide * kSide; i++)
      x.values[c * kSide * kSide + i] = 255 * double{image[(2 - c) * kSide * kSide + i]} - kMean[c];
  const Weights weights = read_weights(folder);
  const auto layer = [&](const std::string& name, int64_t out, int64_t in, int64_t side, int pad) {
    return HostConvolution{
        weights.take(name + ".weight", {out, in, side, side}), weights.take(name + ".bias", {out}), out, side, 1, pad};
  };
  HostConvolution first = layer("conv1", 96, 3, 7, 0);
  first.stride = 2;
  x = convolved(x, first);
  CHECK(worst_difference(taps[0], x) < 1e-5);
  x = pooled(x, 3, 6, 6);  // of 13: nothing is cut; the second pooling's 6 become 3, the last column cut
  for (const auto& [name, in] : {std::pair("fire2", 96), std::pair("fire3", 128)}) {
    const std::string module = name;
    x = convolved(x, layer(module + "/conv1x1_1", 16, in, 1, 0));
    x = joined(convolved(x, layer(module + "/conv1x1_2", 64, 16, 1, 0)),
               convolved(x, layer(module + "/conv3x3_2", 64, 16, 3, 1)));
  }
  CHECK(worst_difference(taps[1], x) < 1e-5);
  CHECK(taps[2].shape() == Shape{1, 256, 3, 3});
  CHECK(taps[3].shape() == Shape{1, 512, 1, 1});
}

TEST_CASE("SqueezeNet sees a red fox") {
  const fs::path folder = squeezenet_folder();
  if (folder.empty() || !fs::exists(test_data("fox"))) return;
  const Image photo = downscale(read_image(test_data("fox/images/0030.jpg")), 4);
  std::vector<float> values;
  for (const std::uint8_t byte : photo.pixels) values.push_back(static_cast<float>(byte) / 255.f);
  const int64_t side = photo.width, top = (photo.height - side) / 2;
  const Tensor whole = permute(from_host(values, {photo.height, side, 3}), {2, 0, 1});
  const Tensor square = resize_bilinear(unsqueeze(slice(whole, 1, top, top + side), 0), 227, 227);
  const Weights weights = read_weights(folder);
  const Shape classifier{1000, 512, 1, 1};
  const Tensor scores =
      conv2d(feature_network(folder)(square).back(),
             from_host(weights.take("conv_final.weight", {1000, 512, 1, 1}), classifier), {.pad = 1},
             {.bias = from_host(weights.take("conv_final.bias", {1000}), {1000}), .activation = Activation::relu});
  const std::vector<float> classes = softmax(mean(scores, {{2, 3}}), 1).to_host();
  const auto best = std::max_element(classes.begin(), classes.end());
  CHECK(best - classes.begin() == 277);
  CHECK(*best > 0.2f);
}

TEST_CASE("VGG-19 from torchvision's names") {
  const fs::path folder = fs::temp_directory_path() / "cloam-vgg-test";
  fs::create_directories(folder);
  const std::vector<std::pair<int, int64_t>> layers = {{0, 64},   {2, 64},   {5, 128},  {7, 128},  {10, 256},
                                                       {12, 256}, {14, 256}, {16, 256}, {19, 512}, {21, 512},
                                                       {23, 512}, {25, 512}, {28, 512}};
  SafetensorsFile file;
  const auto put = [&](const std::string& name, const std::vector<int64_t>& shape, const std::vector<float>& values) {
    std::vector<std::byte> bytes(4 * values.size());
    std::memcpy(bytes.data(), values.data(), bytes.size());
    file.tensors[name] = {"F32", shape, std::move(bytes)};
  };
  // Only the middle taps of the diagonal, so that every layer but the first scales a channel by 1 + its number / 100.
  int64_t in = 3;
  for (const auto& [number, out] : layers) {
    std::vector<float> weight(static_cast<size_t>(out * in * 9));
    for (int64_t k = 0; k < out; k++)
      weight[static_cast<size_t>((k * in + k % in) * 9 + 4)] = 1 + static_cast<float>(number) / 100;
    put("features." + std::to_string(number) + ".weight", {out, in, 3, 3}, weight);
    put("features." + std::to_string(number) + ".bias", {out}, std::vector<float>(static_cast<size_t>(out), 0.25f));
    in = out;
  }
  write_safetensors(folder / "vgg19.safetensors", file);
  const FeatureNetwork net = feature_network(folder);
  fs::remove_all(folder);
  CHECK(net.name == "vgg-19");
  CHECK(net.loss_weights == std::vector<float>{1 / 32.f, 1 / 16.f, 1 / 8.f, 1 / 4.f, 1});
  const Tensors taps = net(full({1, 3, 16, 24}, 0.9f));
  REQUIRE(taps.size() == 5);
  double value = (0.9 - 0.456) / 0.224;  // of channel 1, green
  size_t tap = 0;
  for (const auto& [number, out] : layers) {
    value = value * (1 + number / 100.0) + 0.25;
    if (number != 0 && number != 5 && number != 10 && number != 19 && number != 28) continue;
    const Tensor map = taps[tap];
    CHECK(map.shape() == Shape{1, out, 16 >> tap, 24 >> tap});
    CHECK(slice(map, 1, 1, 2).to_host()[0] == doctest::Approx(value).epsilon(1e-5));
    tap++;
  }
}

TEST_CASE("a file with other weights is refused with names and shapes") {
  const fs::path path = fs::temp_directory_path() / "cloam-other-test";
  const auto bytes = [](size_t count) { return std::vector<std::byte>(4 * count); };
  const auto refused = [&](const SafetensorsFile& file, const char* message) {
    write_safetensors(path, file);
    CHECK_THROWS_WITH_AS(feature_network(path), doctest::Contains(message), Error);
    fs::remove(path);
  };
  refused({{{"encoder.weight", {"F32", {2, 3}, bytes(6)}}}, {}}, "found encoder.weight F32 [2,3]");
  refused({{{"conv1.weight", {"F32", {2, 3}, bytes(6)}}}, {}},
          "looked for conv1.weight F32 [96,3,7,7], found F32 [2,3]");
  refused({{{"features.0.weight", {"F32", {64, 3, 3, 3}, bytes(1728)}}}, {}}, "looked for features.0.bias F32 [64]");
  CHECK_THROWS_WITH_AS(feature_network("/nowhere"), doctest::Contains("no file"), Error);
}
