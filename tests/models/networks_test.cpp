// Image layers against plain loops in double; the U-Net and the asset decoder: sizes, names, gradients, learning; the
// way of colours through field and image decoder.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "models/diffusion/noise_schedule.h"
#include "models/diffusion/unet.h"
#include "models/fields/asset_decoder.h"
#include "models/fields/street_field.h"
#include "models/nn/image_decoder.h"
#include "models/train/optimiser.h"
#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/ops.h"

using namespace cloam;

namespace {

using Doubles = std::vector<double>;

/// An image on the host: the layers written once more as loops.
struct Image {
  int64_t n, c, h, w;
  Doubles values;
  Image(int64_t n_, int64_t c_, int64_t h_, int64_t w_)
      : n(n_), c(c_), h(h_), w(w_), values(static_cast<size_t>(n_ * c_ * h_ * w_)) {}
  explicit Image(const Tensor& t) : Image(t.dim(0), t.dim(1), t.dim(2), t.dim(3)) {
    const std::vector<float> from = t.to_host();
    values.assign(from.begin(), from.end());
  }
  double& at(int64_t i, int64_t k, int64_t y, int64_t x) {
    return values[static_cast<size_t>(((i * c + k) * h + y) * w + x)];
  }
  double at(int64_t i, int64_t k, int64_t y, int64_t x) const {
    return values[static_cast<size_t>(((i * c + k) * h + y) * w + x)];
  }
  double or_zero(int64_t i, int64_t k, int64_t y, int64_t x) const {
    return y < 0 || y >= h || x < 0 || x >= w ? 0.0 : at(i, k, y, x);
  }
};

using Fill = std::function<double(int64_t, int64_t, int64_t, int64_t)>;
Image filled(Image image, const Fill& fill) {
  for (int64_t i = 0; i < image.n; i++)
    for (int64_t k = 0; k < image.c; k++)
      for (int64_t y = 0; y < image.h; y++)
        for (int64_t x = 0; x < image.w; x++) image.at(i, k, y, x) = fill(i, k, y, x);
  return image;
}

Doubles host(const Tensor& t) {
  const std::vector<float> from = t.to_host();
  return {from.begin(), from.end()};
}

Image convolved(const Image& in, const Conv2d& layer) {
  const Image w(layer.weight);
  const Doubles bias = host(layer.bias);
  const int64_t around = w.h / 2;
  const Image out(in.n, w.n, in.h / layer.stride, in.w / layer.stride);
  return filled(out, [&](int64_t i, int64_t k, int64_t y, int64_t x) {
    double sum = bias[static_cast<size_t>(k)];
    for (int64_t c = 0; c < in.c; c++)
      for (int64_t r = 0; r < w.h; r++)
        for (int64_t s = 0; s < w.w; s++)
          sum += in.or_zero(i, c, y * layer.stride + r - around, x * layer.stride + s - around) * w.at(k, c, r, s);
    return sum;
  });
}

Image normalised(const Image& in, const GroupNorm& layer) {
  const Doubles scale = host(layer.scale), shift = host(layer.shift);
  const int64_t size = in.c / layer.groups;
  return filled(in, [&](int64_t i, int64_t k, int64_t y, int64_t x) {
    double sum = 0, squares = 0;
    for (int64_t c = k / size * size; c < (k / size + 1) * size; c++)
      for (int64_t p = 0; p < in.h * in.w; p++) {
        const double v = in.at(i, c, p / in.w, p % in.w);
        sum += v;
        squares += v * v;
      }
    const auto count = static_cast<double>(size * in.h * in.w);
    const double mean = sum / count, variance = squares / count - mean * mean;
    return (in.at(i, k, y, x) - mean) / std::sqrt(variance + 1e-5) * scale[static_cast<size_t>(k)] +
           shift[static_cast<size_t>(k)];
  });
}

Image activated(const Image& in) {
  return filled(in, [&](int64_t i, int64_t k, int64_t y, int64_t x) {
    return in.at(i, k, y, x) / (1 + std::exp(-in.at(i, k, y, x)));
  });
}

Image doubled(const Image& in) {
  return filled(Image(in.n, in.c, 2 * in.h, 2 * in.w),
                [&](int64_t i, int64_t k, int64_t y, int64_t x) { return in.at(i, k, y / 2, x / 2); });
}

/// Rows [N, in] through a linear layer.
Doubles projected(const Doubles& rows, const Linear& layer) {
  const Doubles weight = host(layer.weight), bias = host(layer.bias);
  const size_t in = static_cast<size_t>(layer.weight.dim(0)), out = static_cast<size_t>(layer.weight.dim(1));
  Doubles result;
  for (size_t row = 0; row < rows.size() / in; row++)
    for (size_t k = 0; k < out; k++) {
      double sum = bias[k];
      for (size_t c = 0; c < in; c++) sum += rows[row * in + c] * weight[c * out + k];
      result.push_back(sum);
    }
  return result;
}

Image residual(Image in, const ResBlock& block, const Tensor& embedding) {
  if (block.doubles) in = doubled(in);
  Image h = convolved(activated(normalised(in, block.norm1)), block.conv1);
  if (block.project) {
    const Doubles added = projected(host(embedding), *block.project);
    h = filled(h, [&](int64_t i, int64_t k, int64_t y, int64_t x) {
      return h.at(i, k, y, x) + added[static_cast<size_t>(i * h.c + k)];
    });
  }
  h = convolved(activated(normalised(h, block.norm2)), block.conv2);
  const Image kept = block.skip ? convolved(in, *block.skip) : in;
  return filled(h, [&](int64_t i, int64_t k, int64_t y, int64_t x) { return h.at(i, k, y, x) + kept.at(i, k, y, x); });
}

Image attended(const Image& in, const AttentionBlock& block) {
  const Image normal = normalised(in, block.norm);
  const int64_t places = in.h * in.w, c = in.c;
  const auto number = [](int64_t i) { return static_cast<size_t>(i); };
  Doubles rows;
  for (int64_t i = 0; i < in.n; i++)
    for (int64_t p = 0; p < places; p++)
      for (int64_t k = 0; k < c; k++) rows.push_back(normal.at(i, k, p / in.w, p % in.w));
  const Doubles qkv = projected(rows, block.qkv);
  Doubles mixed(rows.size(), 0.0);
  for (int64_t i = 0; i < in.n; i++)
    for (int64_t p = 0; p < places; p++) {
      Doubles weights;
      double total = 0;
      for (int64_t u = 0; u < places; u++) {
        double dot = 0;
        for (int64_t k = 0; k < c; k++)
          dot += qkv[number((i * places + p) * 3 * c + k)] * qkv[number((i * places + u) * 3 * c + c + k)];
        weights.push_back(std::exp(dot / std::sqrt(static_cast<double>(c))));
        total += weights.back();
      }
      for (int64_t u = 0; u < places; u++)
        for (int64_t k = 0; k < c; k++)
          mixed[number((i * places + p) * c + k)] +=
              weights[number(u)] / total * qkv[number((i * places + u) * 3 * c + 2 * c + k)];
    }
  const Doubles out = projected(mixed, block.out);
  return filled(in, [&](int64_t i, int64_t k, int64_t y, int64_t x) {
    return in.at(i, k, y, x) + out[number((i * places + y * in.w + x) * c + k)];
  });
}

void check_close(const Tensor& got, const Image& want) {
  REQUIRE(got.shape() == Shape{want.n, want.c, want.h, want.w});
  const std::vector<float> values = got.to_host();
  double worst = 0, largest = 0;
  for (size_t i = 0; i < values.size(); i++) {
    worst = std::max(worst, std::abs(static_cast<double>(values[i]) - want.values[i]));
    largest = std::max(largest, std::abs(want.values[i]));
  }
  CHECK(worst < 2e-5 * std::max(1.0, largest));
}

/// Random values for everything, so that no zero hides a mistake.
void shake(Params& params) {
  uint32_t stream = 0;
  for (auto& [name, p] : params)
    assign({{p, p + 0.1f * random_normal(p.shape(), {.seed = 5, .step = 0, .stream = stream++})}});
}

Tensor noise(const Shape& shape, uint64_t seed) {
  const Tensor x = random_normal(shape, {seed});
  eval({x});
  return x;
}

int64_t count(const Params& params) {
  int64_t total = 0;
  for (const auto& [name, p] : params) total += p.numel();
  return total;
}

void check_every_gradient(const Params& params, const Tensor& loss) {
  Tensors wanted;
  for (const auto& [name, p] : params) wanted.push_back(p);
  const Tensors gradients = grad(loss, wanted);
  eval(gradients);
  size_t i = 0;
  for (const auto& [name, p] : params) {
    INFO(name);
    const float largest = max(abs(gradients[i++])).item();
    CHECK(std::isfinite(largest));
    CHECK(largest > 0);
  }
}

Condition conditions(const std::vector<int32_t>& classes, const std::vector<int32_t>& times_of_day) {
  const auto n = static_cast<int64_t>(classes.size());
  return {{from_host(classes, {n}), from_host(times_of_day, {n})}};
}

UnetOptions small_unet() {
  UnetOptions options;
  options.base = 32;
  options.multipliers = {1, 2};
  options.groups = 8;
  return options;
}

}  // namespace

TEST_CASE("convolution layers agree with plain loops: kernel 1 and 3, stride 2, on a doubled image") {
  Params params;
  const Scope scope{params, "", 3};
  const Conv2d plain(scope / "plain", {3, 5}), point(scope / "point", {3, 5, 1}), half(scope / "half", {3, 4, 3, 2});
  shake(params);
  const Tensor x = noise({2, 3, 6, 4}, 1);
  check_close(plain(x), convolved(Image(x), plain));
  check_close(point(x), convolved(Image(x), point));
  check_close(half(x), convolved(Image(x), half));
  check_close(plain.on_doubled(x), convolved(doubled(Image(x)), plain));
}

TEST_CASE("residual blocks agree with plain loops") {
  const Tensor x = noise({2, 6, 4, 3}, 1), embedding = noise({2, 7}, 2);
  for (const ResBlockShape& shape : {ResBlockShape{6, 6, 3}, ResBlockShape{6, 4, 2}, ResBlockShape{6, 8, 2, 7, true},
                                     ResBlockShape{6, 4, 2, 0, false, true}, ResBlockShape{6, 6, 3, 7, true, true}}) {
    Params params;
    const ResBlock block(Scope{params, "", 3}, shape);
    shake(params);
    check_close(block(x, embedding), residual(Image(x), block, embedding));
  }
}

TEST_CASE("the attention block agrees with plain loops") {
  Params params;
  const AttentionBlock block(Scope{params, "", 3}, {6, 2, true});
  shake(params);
  const Tensor x = noise({2, 6, 3, 4}, 1);
  check_close(block(x), attended(Image(x), block));
}

TEST_CASE("a residual or attention block whose last layer is zero begins as its skip") {
  Params params;
  const Scope scope{params, "", 3};
  const ResBlock same(scope / "same", {8, 8, 4, 5, true}), wider(scope / "wider", {8, 12, 4, 5, true});
  const AttentionBlock attention(scope / "attention", {8, 4, true});
  const Tensor x = noise({2, 8, 4, 4}, 1), embedding = noise({2, 5}, 2);
  CHECK(same(x, embedding).to_host() == x.to_host());
  CHECK(attention(x).to_host() == x.to_host());
  CHECK(wider(x, embedding).to_host() == (*wider.skip)(x).to_host());
}

TEST_CASE("times are encoded as sines and cosines of falling rates") {
  const std::vector<float> times = {0, 1, 17.5f, 999};
  const std::vector<float> got = timestep_encoding(from_host(times, {4}), 10).to_host();
  for (size_t row = 0; row < 4; row++)
    for (size_t i = 0; i < 5; i++) {
      const double angle = static_cast<double>(times[row]) * std::exp(-std::log(10000.0) * static_cast<double>(i) / 4);
      CHECK(static_cast<double>(got[row * 10 + i]) == doctest::Approx(std::sin(angle)).epsilon(1e-4));
      CHECK(static_cast<double>(got[row * 10 + 5 + i]) == doctest::Approx(std::cos(angle)).epsilon(1e-4));
    }
  CHECK_THROWS_AS(timestep_encoding(from_host(times, {2, 2}), 10), Error);
}

TEST_CASE("the paper's U-Net has 57.6 M parameters") {
  Params params;
  const Unet unet(Scope{params, "unet", 1});
  CHECK(count(params) == 57639968);
}

TEST_CASE("the asset decoder has 4.9 M parameters and makes 128x128 planes") {
  Params params;
  const AssetDecoder decoder(Scope{params, "decoder", 1});
  // What the paper does not have: the ways past the decoder, and what a class has place by place.
  const int64_t past = (32 + 1) * 36 + (32 + 32 + 1) * 36 * 16, places = 8 * 32 * 64;
  CHECK(count(params) == 4941284 + 8 * 32 + past + places);
  const Tensor planes = decoder(noise({1, 32, 8, 8}, 1), from_host(std::vector<int32_t>{3}, {1}));
  CHECK(planes.shape() == Shape{1, 36, 128, 128});
  CHECK(std::isfinite(sum(planes).item()));
}

TEST_CASE("names of parameters are part of the checkpoint: they stay") {
  Params params;
  UnetOptions options;
  options.base = 8, options.multipliers = {1, 2}, options.blocks = 1, options.groups = 2;
  const Unet unet(Scope{params, "u", 1}, options);
  std::string names;
  for (const auto& [name, p] : params)
    if (name.find(".bias") == std::string::npos && name.find(".shift") == std::string::npos) names += name + " ";
  CHECK(names ==
        "u.class u.down0.block0.conv1.weight u.down0.block0.conv2.weight u.down0.block0.norm1.scale "
        "u.down0.block0.norm2.scale u.down0.block0.project.weight u.down0.halve.weight u.down1.block0.conv1.weight "
        "u.down1.block0.conv2.weight u.down1.block0.norm1.scale u.down1.block0.norm2.scale "
        "u.down1.block0.project.weight u.down1.block0.skip.weight u.enter.weight u.last_norm.scale u.leave.weight "
        "u.middle.attention.norm.scale u.middle.attention.out.weight u.middle.attention.qkv.weight "
        "u.middle.block0.conv1.weight u.middle.block0.conv2.weight u.middle.block0.norm1.scale "
        "u.middle.block0.norm2.scale u.middle.block0.project.weight u.middle.block1.conv1.weight "
        "u.middle.block1.conv2.weight u.middle.block1.norm1.scale u.middle.block1.norm2.scale "
        "u.middle.block1.project.weight u.time1.weight u.time2.weight u.time_of_day u.up0.block0.conv1.weight "
        "u.up0.block0.conv2.weight u.up0.block0.norm1.scale u.up0.block0.norm2.scale u.up0.block0.project.weight "
        "u.up0.block0.skip.weight u.up0.block1.conv1.weight u.up0.block1.conv2.weight u.up0.block1.norm1.scale "
        "u.up0.block1.norm2.scale u.up0.block1.project.weight u.up0.block1.skip.weight u.up1.after_doubling.weight "
        "u.up1.block0.conv1.weight u.up1.block0.conv2.weight u.up1.block0.norm1.scale u.up1.block0.norm2.scale "
        "u.up1.block0.project.weight u.up1.block0.skip.weight u.up1.block1.conv1.weight u.up1.block1.conv2.weight "
        "u.up1.block1.norm1.scale u.up1.block1.norm2.scale u.up1.block1.project.weight u.up1.block1.skip.weight ");
}

TEST_CASE("gradients reach every parameter of the U-Net, and the latent") {
  Params params;
  const Unet unet(Scope{params, "", 1}, small_unet());
  shake(params);
  const Tensor x = parameter(noise({2, 32, 8, 8}, 1).to_host(), {2, 32, 8, 8});
  const Tensor t = from_host(std::vector<float>{10, 700}, {2});
  Params all = params;
  all["latent"] = x;
  check_every_gradient(all, mean(square(unet(x, t, conditions({1, 8}, {0, 2})) - noise({2, 32, 8, 8}, 2))));
  CHECK_THROWS_WITH_AS(unet(noise({1, 32, 7, 8}, 1), t, conditions({0}, {0})), doctest::Contains("multiples of 2"),
                       Error);
}

TEST_CASE("a U-Net is conditioned on an image and on tokens, if it is made for them; tokens say nothing at first") {
  Params params;
  UnetOptions options = small_unet();
  options.labels = {};
  options.image_channels = 3;
  options.context_width = 12;
  const Unet unet(Scope{params, "", 1}, options);
  const Tensor x = noise({2, 32, 8, 8}, 1), t = from_host(std::vector<float>{10, 700}, {2});
  const Tensor image = noise({2, 3, 8, 8}, 2), tokens = noise({2, 5, 12}, 3), others = noise({2, 5, 12}, 4);
  shake(params);
  const Tensor out = params.at("middle.cross_attention.out.weight");
  assign({{out, zeros(out.shape())}});
  CHECK(max(abs(unet(x, t, {{}, image, tokens}) - unet(x, t, {{}, image, others}))).item() == 0);
  shake(params);
  CHECK(max(abs(unet(x, t, {{}, image, tokens}) - unet(x, t, {{}, image, others}))).item() > 1e-4f);
  CHECK(max(abs(unet(x, t, {{}, image, tokens}) - unet(x, t, {{}, noise({2, 3, 8, 8}, 5), tokens}))).item() > 1e-4f);
  // Tokens are a set: their order says nothing.
  const Tensor turned = concat({slice(tokens, 1, 2, 5), slice(tokens, 1, 0, 2)}, 1);
  CHECK(max(abs(unet(x, t, {{}, image, tokens}) - unet(x, t, {{}, image, turned}))).item() < 1e-4f);
  Params all = params;
  check_every_gradient(all, mean(square(unet(x, t, {{}, image, tokens}) - noise({2, 32, 8, 8}, 6))));
  CHECK_THROWS_WITH_AS(unet(x, t, {{}, image, {}}), doctest::Contains("tokens of 12 numbers"), Error);
}

TEST_CASE("gradients reach every parameter of the asset decoder, and the latent") {
  Params params;
  AssetDecoderOptions options;
  options.side = 4, options.middle = 32, options.widths = {32, 16, 16}, options.groups = 4;
  const AssetDecoder decoder(Scope{params, "", 1}, options);
  Params all = params;
  all["latent"] = parameter(noise({2, 32, 4, 4}, 1).to_host(), {2, 32, 4, 4});
  const Tensor planes = decoder(all["latent"], from_host(std::vector<int32_t>{0, 7}, {2}));
  check_every_gradient(all, mean(square(planes - noise({2, 36, 16, 16}, 2))));
  CHECK_THROWS_AS(decoder(noise({2, 31, 4, 4}, 1), from_host(std::vector<int32_t>{0, 7}, {2})), Error);
}

TEST_CASE("a small U-Net learns the velocities of two samples by heart") {
  Params params;
  const Unet unet(Scope{params, "", 1}, small_unet());
  const NoiseSchedule schedule;
  const Shape shape = {2, 32, 8, 8};
  const Tensor x = noise(shape, 1), e = noise(shape, 2);
  const Tensor t = from_host(std::vector<int32_t>{300, 600}, {2});
  const Tensor noisy = schedule.noisy(x, e, t), v = schedule.target(Prediction::velocity, x, e, t);
  const float baseline = mean(square(v - mean(v))).item();
  const ParameterGroups groups = {{"", 2e-3f}};
  Optimiser optimiser(params, groups);
  float loss_now = 0;
  for (int64_t step = 1; step <= 40; step++) {
    Tensors wanted;
    for (const auto& [name, p] : params) wanted.push_back(p);
    const Tensor loss = mean(square(unet(noisy, cast(t, DType::f32), conditions({0, 1}, {0, 1})) - v));
    Tensors all = grad(loss, wanted);
    all.push_back(loss);
    eval(all);
    all.pop_back();
    optimiser.step(params, all, groups, {step});
    loss_now = loss.item();
    if (step == 1) CHECK(loss_now == doctest::Approx(static_cast<double>(mean(square(v)).item())));
  }
  MESSAGE("loss ", loss_now, ", predicting the mean ", baseline);
  CHECK(loss_now < 0.1f * baseline);
}

TEST_CASE("image decoder: the image is as much larger as scale() says, whatever the blocks") {
  for (const auto& [blocks, doublings] : {std::pair{6, 2}, {4, 1}, {3, 2}, {0, 1}, {5, 0}}) {
    CAPTURE(blocks);
    CAPTURE(doublings);
    Params params;
    const ImageDecoder decoder(Scope{params, "", 1},
                               {.features = 4, .width = 4, .side = 3, .blocks = blocks, .doublings = doublings});
    const Tensor image = decoder(zeros({1, 4, 5, 3}));
    CHECK(image.shape() == Shape{1, 3, 5 * decoder.scale(), 3 * decoder.scale()});
  }
}

TEST_CASE("image decoder: an image that has gone black or white still learns") {
  Params params;
  const ImageDecoder decoder(Scope{params, "", 1}, {.features = 4, .width = 4, .side = 3, .blocks = 0, .doublings = 0});
  std::vector<std::pair<Tensor, Tensor>> updates;
  for (const auto& [name, p] : params) updates.push_back({p, zeros(p.shape())});
  assign(updates);
  const std::vector<float> inputs = {7, -30, 0, 30};  // the first goes past no pixel
  const Tensor features = parameter(inputs, {1, 4, 1, 1});
  const Tensor image = decoder(features);
  const std::vector<float> slopes = grad(sum(image), {features})[0].to_host(), pixel = image.to_host();
  CHECK(slopes[0] == 0.f);
  for (size_t c = 0; c < 3; ++c) {
    const double value = 1 / (1 + std::exp(-static_cast<double>(inputs[c + 1])));
    CHECK(pixel[c] == doctest::Approx(value).epsilon(1e-5));
    CHECK(slopes[c + 1] == doctest::Approx(value * (1 - value) + 0.02).epsilon(1e-5));
  }
}

TEST_CASE("image decoder in mixed precision: the gradients of rounded inputs, and less memory for them") {
  const ImageDecoderOptions options = {.features = 8, .width = 16, .side = 3, .blocks = 4, .doublings = 1};
  const Tensor features = random_normal({2, 8, 48, 48}, {1, 0, 0});
  struct Result {
    std::vector<float> image, slope;
    double bytes;
  };
  const auto result = [&](bool half) {
    Params params;
    ImageDecoderOptions how = options;
    how.half = half;
    const ImageDecoder decoder(Scope{params, "", 1}, how);
    Tensors out = {decoder(features)};
    Tensors wanted;
    for (const auto& [name, p] : params) wanted.push_back(p);
    const Tensors slopes = grad(mean(square(out[0] - 0.25f)), wanted);
    out.insert(out.end(), slopes.begin(), slopes.end());
    eval({features});
    trim_memory();  // buffers that are kept may be larger than asked for
    const uint64_t before = device_stats().peak_bytes = device_stats().live_bytes;
    eval(out);
    const auto bytes = static_cast<double>(device_stats().peak_bytes - before);
    Result found = {out[0].to_host(), {}, bytes};
    for (const Tensor& slope : slopes)
      for (const float value : slope.to_host()) found.slope.push_back(value);
    return found;
  };
  const auto apart = [](const std::vector<float>& a, const std::vector<float>& b) {
    double difference = 0, size = 0;
    for (size_t i = 0; i < a.size(); i++) {
      difference += std::pow(static_cast<double>(a[i] - b[i]), 2);
      size += std::pow(static_cast<double>(b[i]), 2);
    }
    return std::sqrt(difference / size);
  };
  (void)result(false);  // whatever is kept from here on
  const Result full = result(false), mixed = result(true);
  MESSAGE("bytes ", full.bytes, " and ", mixed.bytes, ", image ", apart(mixed.image, full.image), ", gradients ",
          apart(mixed.slope, full.slope));
  // A half has 11 bits: 2^-11 is the error of each input, and there are ten convolutions.
  CHECK(apart(mixed.image, full.image) > 0);
  CHECK(apart(mixed.image, full.image) < 10 * 0x1p-11);
  CHECK(apart(mixed.slope, full.slope) < 10 * 0x1p-11);
  const double small = 2 * 16 * 48 * 48, large = 4 * small;  // numbers of a map; two blocks are at each size
  CHECK(full.bytes - mixed.bytes > 0.95 * 2 * (4 * small + 5 * large));
}

TEST_CASE("a paint goes from texels to the image past all networks, and the distance does not") {
  Params params;
  const Scope root{params, "", 1};
  const StreetField field(root / "field", 6, {.width = 4, .features = 8});
  const ImageDecoder decoder(root / "image", {.features = 8, .width = 4, .side = 3, .blocks = 1, .doublings = 0});
  std::vector<std::pair<Tensor, Tensor>> updates;
  for (const auto& [name, p] : params) updates.push_back({p, zeros(p.shape())});
  assign(updates);
  std::vector<float> past(6 * 8, 0.f);
  past[0] = 5, past[1] = 2;  // of the first channel of the first plane, to the distance and to red
  assign({{params.at("field.past.weight"), from_host(past, {6, 8})}});
  const auto geometry = field.geometry(from_host(std::vector<float>{0.5f, 1, 1, 1, 1, 1}, {1, 6}));
  CHECK(geometry.distance.item() == doctest::Approx(2.5));
  const Tensor features = field.features(geometry.inner, zeros({1, 16}));
  const std::vector<float> pixel = decoder(reshape(features, {1, 8, 1, 1})).to_host();
  CHECK(pixel[0] == doctest::Approx(1 / (1 + std::exp(-1.0))));
  CHECK(pixel[1] == doctest::Approx(0.5));
  CHECK(pixel[2] == doctest::Approx(0.5));
}
