// The window is a product of two one-dimensional ones, so each of the five local means is a pass along rows and one
// along columns: 22 multiplications a pixel where the direct sum has 121.
#include "models/metrics/ssim.h"

#include <array>
#include <cmath>
#include <limits>

#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kRadius = 5;
constexpr double kSigma = 1.5;
constexpr double kC1 = 0.01 * 0.01;  // (K1 L)^2 with the value range L = 1
constexpr double kC2 = 0.03 * 0.03;

using Window = std::array<double, 2 * kRadius + 1>;
using Plane = std::vector<double>;  // [H,W]

Window gaussian_window() {
  Window window{};
  double sum = 0;
  for (int i = -kRadius; i <= kRadius; ++i) {
    sum += window[static_cast<size_t>(i + kRadius)] = std::exp(-i * i / (2 * kSigma * kSigma));
  }
  for (double& weight : window) weight /= sum;
  return window;
}

/// One channel's filter: sums of the window around each pixel, values outside the image being zero.
class Blur {
 public:
  Blur(int height, int width)
      : height_(height), width_(static_cast<size_t>(width)), padded_(width_ + 2 * kRadius, 0.0) {}

  Plane operator()(const Plane& plane) {
    Plane rows(plane.size()), result(plane.size(), 0.0);
    for (int y = 0; y < height_; ++y) blur_row(row(plane, y), row(rows, y));
    for (int y = 0; y < height_; ++y) {
      for (int dy = -kRadius; dy <= kRadius; ++dy) {
        if (y + dy < 0 || y + dy >= height_) continue;
        const double* source = row(rows, y + dy);
        double* target = row(result, y);
        const double weight = window_[static_cast<size_t>(dy + kRadius)];
        for (size_t x = 0; x < width_; ++x) target[x] += weight * source[x];
      }
    }
    return result;
  }

 private:
  const double* row(const Plane& plane, int y) const { return plane.data() + static_cast<size_t>(y) * width_; }
  double* row(Plane& plane, int y) const { return plane.data() + static_cast<size_t>(y) * width_; }

  void blur_row(const double* source, double* target) {
    for (size_t x = 0; x < width_; ++x) {
      padded_[x + kRadius] = source[x];
      target[x] = 0;
    }
    for (size_t k = 0; k < window_.size(); ++k) {
      for (size_t x = 0; x < width_; ++x) target[x] += window_[k] * padded_[x + k];
    }
  }

  int height_;
  size_t width_;
  Plane padded_;
  Window window_ = gaussian_window();
};

Plane channel(std::span<const float> image, const ImageShape& shape, int c) {
  const auto channels = static_cast<size_t>(shape.channels);
  Plane plane(image.size() / channels);
  for (size_t i = 0; i < plane.size(); ++i) plane[i] = double{image[i * channels + static_cast<size_t>(c)]};
  return plane;
}

Plane product(const Plane& a, const Plane& b) {
  Plane result(a.size());
  for (size_t i = 0; i < a.size(); ++i) result[i] = a[i] * b[i];
  return result;
}

Plane channel_ssim(const Plane& a, const Plane& b, const ImageShape& shape) {
  Blur blur(shape.height, shape.width);
  const Plane mean_a = blur(a), mean_b = blur(b);
  const Plane mean_aa = blur(product(a, a)), mean_bb = blur(product(b, b)), mean_ab = blur(product(a, b));
  Plane result(a.size());
  for (size_t i = 0; i < a.size(); ++i) {
    const double ab = mean_a[i] * mean_b[i], aa = mean_a[i] * mean_a[i], bb = mean_b[i] * mean_b[i];
    const double luminance = (2 * ab + kC1) / (aa + bb + kC1);
    const double structure = (2 * (mean_ab[i] - ab) + kC2) / ((mean_aa[i] - aa) + (mean_bb[i] - bb) + kC2);
    result[i] = luminance * structure;
  }
  return result;
}

size_t checked_values(std::span<const float> a, std::span<const float> b, const ImageShape& shape) {
  const bool positive = shape.height > 0 && shape.width > 0 && shape.channels > 0;
  const size_t values = positive ? size_t(shape.height) * size_t(shape.width) * size_t(shape.channels) : 0;
  if (!positive || a.size() != values || b.size() != values)
    bad_data("ssim of [", shape.height, ",", shape.width, ",", shape.channels, "] needs ", values, " values each, got ",
             a.size(), " and ", b.size());
  return values;
}

std::vector<float> on_black(std::span<const float> image, std::span<const uint8_t> mask, size_t channels) {
  std::vector<float> result(image.begin(), image.end());
  for (size_t i = 0; i < result.size(); ++i) {
    if (mask[i / channels] == 0) result[i] = 0;
  }
  return result;
}

}  // namespace

std::vector<double> ssim_map(std::span<const float> a, std::span<const float> b, const ImageShape& shape) {
  const auto channels = static_cast<size_t>(shape.channels);
  std::vector<double> map(checked_values(a, b, shape));
  for (int c = 0; c < shape.channels; ++c) {
    const Plane plane = channel_ssim(channel(a, shape, c), channel(b, shape, c), shape);
    for (size_t i = 0; i < plane.size(); ++i) map[i * channels + static_cast<size_t>(c)] = plane[i];
  }
  return map;
}

double ssim(std::span<const float> a, std::span<const float> b, const ImageShape& shape) {
  double sum = 0;
  for (const double value : ssim_map(a, b, shape)) sum += value;
  return sum / static_cast<double>(a.size());
}

double masked_ssim(std::span<const float> a, std::span<const float> b, std::span<const uint8_t> mask,
                   const ImageShape& shape) {
  const size_t values = checked_values(a, b, shape);
  const auto channels = static_cast<size_t>(shape.channels);
  if (mask.size() != values / channels)
    bad_data("masked ssim needs a mask of ", values / channels, " pixels, got ", mask.size());
  const std::vector<double> map = ssim_map(on_black(a, mask, channels), on_black(b, mask, channels), shape);
  double sum = 0;
  size_t count = 0;
  for (size_t i = 0; i < values; ++i) {
    if (mask[i / channels] == 0) continue;
    sum += map[i];
    ++count;
  }
  return count == 0 ? std::numeric_limits<double>::quiet_NaN() : sum / static_cast<double>(count);
}

}  // namespace cloam
