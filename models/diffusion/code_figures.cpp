// See code_figures.h.
#include "models/diffusion/code_figures.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cloam {
namespace {

constexpr std::size_t kMaxPairs = 400;  // codes, of which all pairs are measured

double distance(const Code& a, const Code& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += std::pow(double{a[i]} - double{b[i]}, 2);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

double median(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

double copy_ratio(const LabelledCodes& samples, const LabelledCodes& training) {
  std::vector<double> nearest, between;
  for (const Code& sample : samples.codes) {
    double least = std::numeric_limits<double>::infinity();
    for (const Code& code : training.codes) least = std::min(least, distance(sample, code));
    nearest.push_back(least);
  }
  const std::size_t step = 1 + training.count() / kMaxPairs;
  for (std::size_t i = 0; i < training.count(); i += step)
    for (std::size_t j = i + step; j < training.count(); j += step)
      between.push_back(distance(training.codes[i], training.codes[j]));
  return median(nearest) / median(between);
}

}  // namespace cloam
