// See code_figures.h.
#include "models/diffusion/code_figures.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace cloam {
namespace {

constexpr std::size_t kMostPairs = 400;  // codes, of which all pairs are measured

double distance(const float* a, const float* b, std::size_t width) {
  double sum = 0;
  for (std::size_t i = 0; i < width; ++i) sum += std::pow(double{a[i]} - double{b[i]}, 2);
  return std::sqrt(sum / static_cast<double>(width));
}

double median(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

void LabelledCodes::add(const std::vector<float>& code, int asset_class) {
  width = code.size();
  codes.insert(codes.end(), code.begin(), code.end());
  classes.push_back(asset_class);
}

double copy_ratio(const LabelledCodes& samples, const LabelledCodes& training) {
  std::vector<double> nearest, between;
  const std::size_t width = training.width, step = 1 + training.count() / kMostPairs;
  for (std::size_t i = 0; i < samples.count(); ++i) {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < training.count(); ++j)
      least = std::min(least, distance(&samples.codes[i * width], &training.codes[j * width], width));
    nearest.push_back(least);
  }
  for (std::size_t i = 0; i < training.count(); i += step)
    for (std::size_t j = i + step; j < training.count(); j += step)
      between.push_back(distance(&training.codes[i * width], &training.codes[j * width], width));
  return median(nearest) / median(between);
}

double share_of_right_classes(const LabelledCodes& samples, const LabelledCodes& training) {
  const std::size_t width = training.width;
  std::map<int, std::pair<std::vector<float>, float>> prototypes;  // sum and count, then mean
  for (std::size_t i = 0; i < training.count(); ++i) {
    auto& [sum, count] = prototypes[training.classes[i]];
    sum.resize(width);
    for (std::size_t k = 0; k < width; ++k) sum[k] += training.codes[i * width + k];
    count += 1;
  }
  for (auto& [name, prototype] : prototypes)
    for (float& value : prototype.first) value /= prototype.second;
  std::size_t right = 0;
  for (std::size_t i = 0; i < samples.count(); ++i) {
    const auto apart = [&](const auto& entry) {
      return distance(&samples.codes[i * width], entry.second.first.data(), width);
    };
    const auto nearest = std::min_element(prototypes.begin(), prototypes.end(),
                                          [&](const auto& a, const auto& b) { return apart(a) < apart(b); });
    right += nearest->first == samples.classes[i];
  }
  return static_cast<double>(right) / static_cast<double>(samples.count());
}

}  // namespace cloam
