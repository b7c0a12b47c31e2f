// PSNR against its closed form, SSIM against the direct two-dimensional sum in double.
#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <random>

#include "models/metrics/overlap.h"
#include "models/metrics/psnr.h"
#include "models/metrics/ssim.h"
#include "runtime/error.h"
#include "runtime/ops.h"
#include "runtime/ops/ssim.h"

using namespace cloam;

namespace {

using Values = std::vector<float>;

Values noise(size_t count, unsigned seed) {
  std::mt19937 random(seed);
  Values values(count);
  for (float& value : values) value = static_cast<float>(random() % 4096) / 4095.0F;
  return values;
}

struct Moments {
  double a = 0, b = 0, aa = 0, bb = 0, ab = 0;
};

/// SSIM at one value: 121 terms of exp(-(dx^2+dy^2)/4.5), zero outside the image.
double direct_ssim(const Values& a, const Values& b, const ImageShape& shape, std::array<int, 3> where) {
  double total = 0;
  for (int dy = -5; dy <= 5; ++dy) {
    for (int dx = -5; dx <= 5; ++dx) total += std::exp(-(dx * dx + dy * dy) / 4.5);
  }
  Moments mean;
  for (int dy = -5; dy <= 5; ++dy) {
    for (int dx = -5; dx <= 5; ++dx) {
      const int y = where[0] + dy, x = where[1] + dx;
      if (y < 0 || x < 0 || y >= shape.height || x >= shape.width) continue;
      const auto i = static_cast<size_t>((y * shape.width + x) * shape.channels + where[2]);
      const double weight = std::exp(-(dx * dx + dy * dy) / 4.5) / total;
      const double p = double{a[i]}, q = double{b[i]};
      mean.a += weight * p, mean.b += weight * q;
      mean.aa += weight * p * p, mean.bb += weight * q * q, mean.ab += weight * p * q;
    }
  }
  const double variance_a = mean.aa - mean.a * mean.a, variance_b = mean.bb - mean.b * mean.b;
  return (2 * mean.a * mean.b + 1e-4) * (2 * (mean.ab - mean.a * mean.b) + 9e-4) /
         ((mean.a * mean.a + mean.b * mean.b + 1e-4) * (variance_a + variance_b + 9e-4));
}

}  // namespace

TEST_CASE("psnr: closed form") {
  const Values a(300, 0.5F), b(300, 0.6F);
  CHECK(psnr(a, b) == doctest::Approx(20.0).epsilon(1e-6));  // error 0.1 everywhere: 20 dB
  CHECK(psnr(a, a) == std::numeric_limits<double>::infinity());
  Values one = a;
  one[7] = 0.0F;
  CHECK(psnr(a, one) == doctest::Approx(10 * std::log10(300 / 0.25)));
}

TEST_CASE("psnr: only masked pixels count, with all their channels") {
  Values a(12, 0.5F), b(12, 0.5F);
  b[0] = 1.0F;   // pixel 0, masked out
  b[11] = 0.4F;  // pixel 3, channel 2
  const std::vector<uint8_t> mask{0, 1, 0, 255};
  CHECK(masked_psnr(a, b, mask, 3) == doctest::Approx(10 * std::log10(6 / 0.01)).epsilon(1e-6));
  CHECK(std::isnan(masked_psnr(a, b, std::vector<uint8_t>(4, 0), 3)));
}

TEST_CASE("ssim: the direct sum in double") {
  const ImageShape shape{17, 23, 3};  // wider and narrower than the window: borders everywhere
  const Values a = noise(17 * 23 * 3, 1), b = noise(17 * 23 * 3, 2);
  const std::vector<double> map = ssim_map(a, b, shape);
  double sum = 0, worst = 0;
  for (int y = 0; y < 17; ++y) {
    for (int x = 0; x < 23; ++x) {
      for (int c = 0; c < 3; ++c) {
        const double want = direct_ssim(a, b, shape, {y, x, c});
        worst = std::max(worst, std::abs(want - map[static_cast<size_t>((y * 23 + x) * 3 + c)]));
        sum += want;
      }
    }
  }
  CHECK(worst < 1e-9);
  CHECK(ssim(a, b, shape) == doctest::Approx(sum / (17 * 23 * 3)).epsilon(1e-9));
}

TEST_CASE("ssim: equal images give 1, and more noise gives less") {
  const ImageShape shape{20, 20, 1};
  const Values a = noise(400, 3), b = noise(400, 4);
  Values near = a, far = a;
  for (size_t i = 0; i < a.size(); ++i) {
    near[i] += 0.1F * (b[i] - a[i]);
    far[i] += 0.5F * (b[i] - a[i]);
  }
  CHECK(ssim(a, a, shape) == doctest::Approx(1.0).epsilon(1e-12));
  CHECK(ssim(a, near, shape) > ssim(a, far, shape));
  CHECK(ssim(a, far, shape) > ssim(a, b, shape));
}

TEST_CASE("ssim: constant images have the closed form of the luminance term, inside and at a corner") {
  const ImageShape shape{31, 31, 1};
  const Values a(31 * 31, 0.2F), b(31 * 31, 0.8F);
  const std::vector<double> map = ssim_map(a, b, shape);
  CHECK(map[15 * 31 + 15] == doctest::Approx((2 * 0.16 + 1e-4) / (0.04 + 0.64 + 1e-4)).epsilon(1e-6));
  CHECK(map[0] < map[15 * 31 + 15]);  // the zero padding reads as structure that differs
}

TEST_CASE("ssim: outside the mask nothing matters") {
  const ImageShape shape{16, 16, 3};
  const Values a = noise(768, 5), b = noise(768, 6);
  std::vector<uint8_t> mask(256, 0);
  for (size_t i = 0; i < 128; ++i) mask[i] = 1;
  Values changed = b;
  for (size_t i = 128 * 3; i < changed.size(); ++i) changed[i] = 0.9F;
  CHECK(masked_ssim(a, b, mask, shape) == masked_ssim(a, changed, mask, shape));
  CHECK(masked_ssim(a, a, mask, shape) == doctest::Approx(1.0));
  CHECK(masked_ssim(a, b, std::vector<uint8_t>(256, 1), shape) == doctest::Approx(ssim(a, b, shape)));
}

TEST_CASE("ssim: the mean over the mask, of both images painted black elsewhere, by the direct sum") {
  const ImageShape shape{14, 19, 3};
  const Values a = noise(14 * 19 * 3, 7), b = noise(14 * 19 * 3, 8);
  std::vector<uint8_t> mask(14 * 19);
  for (size_t i = 0; i < mask.size(); ++i) mask[i] = i % 19 > 4 && i % 5 != 0 && i < 200 ? 255 : 0;
  Values black_a = a, black_b = b;
  for (size_t i = 0; i < a.size(); ++i)
    if (mask[i / 3] == 0) black_a[i] = black_b[i] = 0;
  double sum = 0;
  int count = 0;
  for (int y = 0; y < 14; ++y)
    for (int x = 0; x < 19; ++x)
      for (int c = 0; c < 3 && mask[static_cast<size_t>(y * 19 + x)] != 0; ++c, ++count)
        sum += direct_ssim(black_a, black_b, shape, {y, x, c});
  CHECK(masked_ssim(a, b, mask, shape) == doctest::Approx(sum / count).epsilon(1e-9));
}

/// [H,W,C] as the op takes pictures.
Tensor planes(const Values& image, const ImageShape& shape) {
  const Shape interleaved{shape.height, shape.width, shape.channels};
  return permute(from_host(image, interleaved), {2, 0, 1});
}

/// A smooth picture and one that is like it; a direction from each value of the first to the second's, all
/// exact in float32.
struct Pictures {
  explicit Pictures(const ImageShape& shape) {
    std::mt19937 random(5);
    for (int i = 0; i < shape.height * shape.width * shape.channels; ++i) {
      const double smooth = 0.5 + 0.4 * std::sin(i * 0.011) * std::cos(i / shape.width * 0.05);
      const auto grain = [&] { return static_cast<double>(random() % 256) - 128; };
      a.push_back(static_cast<float>((std::round(smooth * 4096) + grain()) / 4096));
      b.push_back(static_cast<float>((std::round(smooth * 4096) + 2 * grain()) / 4096));
      direction.push_back(b.back() < a.back() ? -1.F : 1.F);
    }
  }
  Values moved(float step) const {
    Values result = a;
    for (size_t i = 0; i < a.size(); ++i) result[i] += step * direction[i];
    return result;
  }
  Values a, b, direction;
};

TEST_CASE("ssim: what training minimises is the metric, and its gradient the metric's slope") {
  const ImageShape shape{181, 323, 3};
  const Pictures of(shape);
  const float step = 1.F / 4096;
  const double slope = (ssim(of.moved(step), of.b, shape) - ssim(of.moved(-step), of.b, shape)) / (2 * double{step});

  const Tensor x = parameter(planes(of.a, shape).to_host(), {3, 181, 323});
  const Tensor similar = likeness(x, planes(of.b, shape)).ssim;
  const Tensor along = sum(grad(similar, {x})[0] * planes(of.direction, shape));
  eval({similar, along});
  CHECK(similar.item() == doctest::Approx(ssim(of.a, of.b, shape)).epsilon(1e-6));
  CHECK(along.item() == doctest::Approx(slope).epsilon(1e-3));
}

TEST_CASE("metrics: sizes that disagree are data errors") {
  const Values a(12, 0.F), b(9, 0.F);
  CHECK_THROWS_AS(psnr(a, b), Error);
  CHECK_THROWS_AS(psnr({}, {}), Error);
  CHECK_THROWS_AS(masked_psnr(a, a, std::vector<uint8_t>(5, 1), 3), Error);
  CHECK_THROWS_AS(ssim(a, a, {2, 2, 4}), Error);
  CHECK_THROWS_AS(ssim(a, a, {2, 2, -3}), Error);
}

TEST_CASE("overlap: pixels in common over pixels of either, mean over the instances that are large enough") {
  const std::vector<int> truth = {1, 1, 1, 1, 2, 2, 3, 0}, shown = {0, 1, 1, 2, 2, 2, 0, 1};
  // 1: two in common, of four and one more; 2: two in common, of two and one more; 3 is small; 0 is nothing.
  CHECK(mean_overlap(shown, truth, 2) == doctest::Approx((2. / 5 + 2. / 3) / 2));
  CHECK(mean_overlap(shown, truth, 3) == doctest::Approx(2. / 5));
  CHECK(mean_overlap(shown, truth, 1) == doctest::Approx((2. / 5 + 2. / 3 + 0) / 3));
  CHECK(mean_overlap(truth, truth, 1) == 1);
  CHECK(std::isnan(mean_overlap(shown, truth, 5)));
  CHECK(std::isnan(mean_overlap(std::vector<int>{1}, std::vector<int>{0}, 0)));  // shown alone
  CHECK_THROWS_AS(mean_overlap(shown, std::vector<int>(7), 1), Error);
}
