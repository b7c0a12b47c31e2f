// LPIPS with random weights of the true shapes against plain loops in float64 that follow the papers' and torchvision's
// tables, and whose weights bear its name.
#include "models/metrics/lpips.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include "models/io/safetensors.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

using namespace cloam;

namespace {

struct Layer {
  int number;  // in torchvision's module "features"
  int64_t out, side, stride, pad;
  int64_t pooling;  // window of the pooling before it, of stride 2; 0: none
  bool tap;
};

const std::vector<Layer> kAlex = {{0, 64, 11, 4, 2, 0, true},
                                  {3, 192, 5, 1, 2, 3, true},
                                  {6, 384, 3, 1, 1, 3, true},
                                  {8, 256, 3, 1, 1, 0, true},
                                  {10, 256, 3, 1, 1, 0, true}};

const std::vector<Layer> kVgg = {
    {0, 64, 3, 1, 1, 0, false},  {2, 64, 3, 1, 1, 0, true},    {5, 128, 3, 1, 1, 2, false},
    {7, 128, 3, 1, 1, 0, true},  {10, 256, 3, 1, 1, 2, false}, {12, 256, 3, 1, 1, 0, false},
    {14, 256, 3, 1, 1, 0, true}, {17, 512, 3, 1, 1, 2, false}, {19, 512, 3, 1, 1, 0, false},
    {21, 512, 3, 1, 1, 0, true}, {24, 512, 3, 1, 1, 2, false}, {26, 512, 3, 1, 1, 0, false},
    {28, 512, 3, 1, 1, 0, true},
};

struct Map {
  int64_t channels, height, width;
  std::vector<double> values;
  double& at(int64_t c, int64_t y, int64_t x) { return values[static_cast<size_t>((c * height + y) * width + x)]; }
  double at(int64_t c, int64_t y, int64_t x) const { return const_cast<Map*>(this)->at(c, y, x); }
};

Map empty_map(int64_t channels, int64_t height, int64_t width) {
  return {channels, height, width, std::vector<double>(static_cast<size_t>(channels * height * width))};
}

Map pooled(const Map& x, int64_t window) {
  Map y = empty_map(x.channels, (x.height - window) / 2 + 1, (x.width - window) / 2 + 1);
  for (int64_t c = 0; c < y.channels; c++)
    for (int64_t p = 0; p < y.height; p++)
      for (int64_t q = 0; q < y.width; q++) {
        double best = -std::numeric_limits<double>::infinity();
        for (int64_t i = 0; i < window * window; i++)
          best = std::max(best, x.at(c, 2 * p + i / window, 2 * q + i % window));
        y.at(c, p, q) = best;
      }
  return y;
}

/// ReLU(convolution).
Map convolved(const Map& x, const Layer& l, const std::vector<float>& weight, const std::vector<float>& bias) {
  Map y =
      empty_map(l.out, (x.height + 2 * l.pad - l.side) / l.stride + 1, (x.width + 2 * l.pad - l.side) / l.stride + 1);
  const int64_t taps = l.side * l.side;
  for (int64_t k = 0; k < l.out; k++)
    for (int64_t p = 0; p < y.height; p++)
      for (int64_t q = 0; q < y.width; q++) {
        double sum = double{bias[static_cast<size_t>(k)]};
        for (int64_t i = 0; i < taps; i++) {
          const int64_t row = p * l.stride + i / l.side - l.pad, column = q * l.stride + i % l.side - l.pad;
          if (row < 0 || column < 0 || row >= x.height || column >= x.width) continue;
          for (int64_t c = 0; c < x.channels; c++)
            sum += double{weight[static_cast<size_t>((k * x.channels + c) * taps + i)]} * x.at(c, row, column);
        }
        y.at(k, p, q) = std::max(sum, 0.0);
      }
  return y;
}

NamedTensor named(const std::vector<int64_t>& shape, const std::vector<float>& values) {
  NamedTensor tensor{"F32", shape, std::vector<std::byte>(4 * values.size())};
  std::memcpy(tensor.data.data(), values.data(), tensor.data.size());
  return tensor;
}

struct Drawn {
  std::mt19937 random{3};

  std::vector<float> values(int64_t count, float low, float high) {
    std::vector<float> all(static_cast<size_t>(count));
    for (float& value : all) value = low + (high - low) * static_cast<float>(random() >> 8) * 0x1p-24f;
    return all;
  }

  Weights backbone(const std::vector<Layer>& layers) {
    Weights weights{"drawn", {}, ""};
    int64_t in = 3;
    for (const Layer& l : layers) {
      const int64_t taps = in * l.side * l.side;
      const float bound = std::sqrt(6.f / static_cast<float>(taps));
      const std::string name = "features." + std::to_string(l.number);
      weights.tensors[name + ".weight"] = named({l.out, in, l.side, l.side}, values(l.out * taps, -bound, bound));
      weights.tensors[name + ".bias"] = named({l.out}, values(l.out, -0.2f, 0.2f));
      in = l.out;
    }
    return weights;
  }

  /// Some are 0, as of the learned ones.
  Weights linear(const std::vector<Layer>& layers) {
    Weights weights{"drawn", {}, ""};
    int tap = 0;
    for (const Layer& l : layers) {
      if (!l.tap) continue;
      std::vector<float> all = values(l.out, -0.3f, 1);
      for (float& value : all) value = std::max(value, 0.f);
      weights.tensors["lin" + std::to_string(tap++) + ".model.1.weight"] = named({1, l.out, 1, 1}, all);
    }
    return weights;
  }
};

Map image(int64_t height, int64_t width, unsigned seed) {
  Drawn drawn{std::mt19937(seed)};
  const std::vector<float> values = drawn.values(3 * height * width, 0, 1);
  return {3, height, width, {values.begin(), values.end()}};
}

Tensor tensor_of(const Map& map) {
  return from_host(std::vector<float>(map.values.begin(), map.values.end()), {1, 3, map.height, map.width});
}

std::vector<Map> taps_of(const std::vector<Layer>& layers, const Weights& weights, Map x) {
  constexpr double kShift[] = {-.030, -.088, -.188}, kScale[] = {.458, .448, .450};
  const size_t pixels = x.values.size() / 3;
  for (size_t i = 0; i < x.values.size(); i++)
    x.values[i] = (2 * x.values[i] - 1 - kShift[i / pixels]) / kScale[i / pixels];
  std::vector<Map> taps;
  for (const Layer& l : layers) {
    if (l.pooling > 0) x = pooled(x, l.pooling);
    const std::string name = "features." + std::to_string(l.number);
    x = convolved(x, l, weights.take(name + ".weight", {l.out, x.channels, l.side, l.side}),
                  weights.take(name + ".bias", {l.out}));
    if (l.tap) taps.push_back(x);
  }
  return taps;
}

double length_at(const Map& map, int64_t y, int64_t x) {
  double sum = 0;
  for (int64_t c = 0; c < map.channels; c++) sum += map.at(c, y, x) * map.at(c, y, x);
  return std::sqrt(sum) + 1e-10;
}

double lpips_by_loops(const std::vector<Layer>& layers, const Weights& backbone, const Weights& linear, const Map& a,
                      const Map& b) {
  const std::vector<Map> of_a = taps_of(layers, backbone, a), of_b = taps_of(layers, backbone, b);
  double total = 0;
  for (size_t t = 0; t < of_a.size(); t++) {
    const Map &p = of_a[t], &q = of_b[t];
    const auto weights = linear.take("lin" + std::to_string(t) + ".model.1.weight", {1, p.channels, 1, 1});
    double sum = 0;
    for (int64_t y = 0; y < p.height; y++)
      for (int64_t x = 0; x < p.width; x++)
        for (int64_t c = 0; c < p.channels; c++) {
          const double difference = p.at(c, y, x) / length_at(p, y, x) - q.at(c, y, x) / length_at(q, y, x);
          sum += double{weights[static_cast<size_t>(c)]} * difference * difference;
        }
    total += sum / static_cast<double>(p.height * p.width);
  }
  return total;
}

/// The factor on all of a tensor's values.
void scale(Weights& weights, const std::string& name, float factor) {
  NamedTensor& tensor = weights.tensors.at(name);
  std::vector<float> values(tensor.data.size() / 4);
  std::memcpy(values.data(), tensor.data.data(), tensor.data.size());
  for (float& value : values) value *= factor;
  tensor = named(tensor.shape, values);
}

}  // namespace

TEST_CASE("LPIPS with AlexNet: the reference in float64, for a picture that no stride divides") {
  Drawn drawn;
  Weights backbone = drawn.backbone(kAlex);
  const Weights linear = drawn.linear(kAlex);
  const Map a = image(47, 66, 1), b = image(47, 66, 2);
  Map near = a;
  for (size_t i = 0; i < near.values.size(); i++) near.values[i] = 0.9 * a.values[i] + 0.1 * b.values[i];
  const Lpips metric = lpips(backbone, linear);
  for (const Map& other : {b, near}) {
    const double want = lpips_by_loops(kAlex, backbone, linear, a, other);
    CHECK(want > 1e-3);
    CHECK(metric(tensor_of(a), tensor_of(other)).to_host()[0] == doctest::Approx(want).epsilon(1e-4));
  }
  CHECK(metric(tensor_of(a), tensor_of(a)).to_host()[0] == 0);
  const Tensor two = metric(concat({tensor_of(a), tensor_of(a)}, 0), concat({tensor_of(b), tensor_of(near)}, 0));
  CHECK(two.shape() == Shape{2});
  CHECK(two.to_host()[1] < 0.5f * two.to_host()[0]);
  // Features far shorter than 1 are scaled to 1 all the same, and those of length 0 stay 0.
  for (const float factor : {1e-7f, 0.f}) {
    scale(backbone, "features.10.weight", factor), scale(backbone, "features.10.bias", factor);
    CHECK(lpips(backbone, linear)(tensor_of(a), tensor_of(b)).to_host()[0] ==
          doctest::Approx(lpips_by_loops(kAlex, backbone, linear, a, b)).epsilon(1e-4));
  }
}

TEST_CASE("LPIPS with VGG-16: the reference in float64") {
  Drawn drawn;
  const Weights backbone = drawn.backbone(kVgg), linear = drawn.linear(kVgg);
  const Map a = image(17, 24, 1), b = image(17, 24, 2);
  const double want = lpips_by_loops(kVgg, backbone, linear, a, b);
  const Lpips metric = lpips(backbone, linear);
  CHECK(metric.name == "lpips-vgg-v0.1, unverified weights");
  CHECK(metric(tensor_of(a), tensor_of(b)).to_host()[0] == doctest::Approx(want).epsilon(1e-4));
}

TEST_CASE("LPIPS bears its name only with both published files") {
  Drawn drawn;
  Weights backbone = drawn.backbone(kAlex), linear = drawn.linear(kAlex);
  const std::string alex = "7be5be791159472b1fbf3c69796f7cb30dca7ad8466c2df70058c37116cdee02";
  const std::string learned = "df73285e35b22355a2df87cdb6b70b343713b667eddbda73e1977e0c860835c0";
  const std::string of_vgg = "a78928a0af1e5f0fcb1f3b9e8f8c3a2a5a3de244d830ad5c1feddc79b8432868";
  const auto name_of = [&](const std::string& first, const std::string& second) {
    backbone.sha256 = first, linear.sha256 = second;
    const Lpips metric = lpips(backbone, linear);
    CHECK(metric.published() == (lpips_key(metric.name) == "lpips"));
    return metric.name;
  };
  CHECK(name_of(alex, learned) == "lpips-alex-v0.1");
  CHECK(lpips_key(name_of(alex, learned)) == "lpips");
  CHECK(lpips_key("lpips-vgg-v0.1") == "lpips");
  for (const auto& [first, second] : {std::pair(alex, of_vgg), std::pair(learned, learned), std::pair(alex, alex),
                                      std::pair(std::string(), learned)}) {
    CHECK(name_of(first, second) == "lpips-alex-v0.1, unverified weights");
    CHECK(lpips_key(name_of(first, second)) == "perceptual_distance");
  }
}

TEST_CASE("LPIPS from two files, or from one that holds both; weights that are none of its are refused") {
  const Folder folder;
  Drawn drawn;
  const Weights backbone = drawn.backbone(kAlex), linear = drawn.linear(kAlex);
  const auto path = [&](const char* name) { return (folder.path / name).string(); };
  TensorMap both = backbone.tensors;
  both.insert(linear.tensors.begin(), linear.tensors.end());
  write_safetensors(path("backbone"), {backbone.tensors, {}});
  write_safetensors(path("linear"), {linear.tensors, {}});
  write_safetensors(path("both,in,one"), {both, {}});
  const Map a = image(35, 40, 1), b = image(35, 40, 2);
  const auto value_of = [&](const std::string& files) {
    return lpips_named(files)(tensor_of(a), tensor_of(b)).to_host()[0];
  };
  CHECK(value_of(path("backbone") + "," + path("linear")) == value_of(path("both,in,one")));
  CHECK(value_of(path("both,in,one")) == lpips(backbone, linear)(tensor_of(a), tensor_of(b)).to_host()[0]);
  CHECK(holds(error_of([&] { lpips_named(path("backbone")); }), "looked for lin0.model.1.weight F32 [1,64,1,1]"));
  CHECK(holds(error_of([&] { lpips_named(path("none") + "," + path("linear")); }), "none: want a file of weights"));
  CHECK(
      holds(error_of([&] { lpips(backbone, drawn.linear(kVgg)); }), "looked for lin1.model.1.weight F32 [1,192,1,1]"));
  Weights negative = linear;
  scale(negative, "lin2.model.1.weight", -1);
  CHECK(holds(error_of([&] { lpips(backbone, negative); }), "lin2.model.1.weight has values below 0"));
}
