// Sums are kept in double: a float sum over a megapixel loses three of its seven digits.
#include "models/metrics/psnr.h"

#include <cmath>
#include <limits>

#include "runtime/error.h"

namespace cloam {
namespace {

void need_same_size(size_t a, size_t b) {
  if (a != b || a == 0) bad_data("psnr needs two images of one size, got ", a, " and ", b, " values");
}

double squared(double value) { return value * value; }

}  // namespace

double psnr_of_error(double mean_squared_error) { return -10.0 * std::log10(mean_squared_error); }

double psnr(std::span<const float> a, std::span<const float> b) {
  need_same_size(a.size(), b.size());
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += squared(double{a[i]} - double{b[i]});
  return psnr_of_error(sum / static_cast<double>(a.size()));
}

double masked_psnr(std::span<const float> a, std::span<const float> b, std::span<const uint8_t> mask, int channels) {
  need_same_size(a.size(), b.size());
  if (channels < 1 || a.size() % static_cast<size_t>(channels) != 0)
    bad_data("an image of ", a.size(), " values does not divide into ", channels, " channels");
  const auto width = static_cast<size_t>(channels);
  need_same_size(a.size() / width, mask.size());
  double sum = 0;
  size_t count = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    if (mask[i / width] == 0) continue;
    sum += squared(double{a[i]} - double{b[i]});
    ++count;
  }
  return count == 0 ? std::numeric_limits<double>::quiet_NaN() : psnr_of_error(sum / static_cast<double>(count));
}

}  // namespace cloam
