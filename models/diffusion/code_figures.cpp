// See code_figures.h.
#include "models/diffusion/code_figures.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace cloam {
namespace {

constexpr std::size_t kMaxPairs = 400;  // codes, of which all pairs are measured
constexpr std::size_t kPrototypes = 2;  // of a class
constexpr int kRounds = 10;             // of finding them

double distance(const Code& a, const Code& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += std::pow(double{a[i]} - double{b[i]}, 2);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

std::size_t nearest_of(const std::vector<Code>& prototypes, const Code& code) {
  const auto closer = [&](const Code& a, const Code& b) { return distance(a, code) < distance(b, code); };
  return static_cast<std::size_t>(std::min_element(prototypes.begin(), prototypes.end(), closer) - prototypes.begin());
}

Code mean_of(const std::vector<Code>& codes) {
  Code mean(codes.front().size());
  for (const Code& code : codes)
    for (std::size_t k = 0; k < mean.size(); ++k) mean[k] += code[k] / static_cast<float>(codes.size());
  return mean;
}

/// k-means (Lloyd 1982), from codes that are far apart.
std::vector<Code> prototypes_of(const std::vector<Code>& codes) {
  std::vector<Code> prototypes = {mean_of(codes)};
  const auto apart = [&](const Code& code) { return distance(prototypes[nearest_of(prototypes, code)], code); };
  const auto farthest = [&] {
    return *std::max_element(codes.begin(), codes.end(),
                             [&](const Code& a, const Code& b) { return apart(a) < apart(b); });
  };
  prototypes = {farthest()};
  while (prototypes.size() < kPrototypes) prototypes.push_back(farthest());
  for (int round = 0; round < kRounds; ++round) {
    std::vector<std::vector<Code>> members(prototypes.size());
    for (const Code& code : codes) members[nearest_of(prototypes, code)].push_back(code);
    for (std::size_t i = 0; i < members.size(); ++i)
      if (!members[i].empty()) prototypes[i] = mean_of(members[i]);
  }
  return prototypes;
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

double share_of_right_classes(const LabelledCodes& samples, const LabelledCodes& training) {
  std::map<int, std::vector<Code>> of_class;
  for (std::size_t i = 0; i < training.count(); ++i) of_class[training.classes[i]].push_back(training.codes[i]);
  std::vector<Code> prototypes;
  std::vector<int> classes;
  for (const auto& [asset_class, codes] : of_class)
    for (const Code& prototype : prototypes_of(codes)) {
      prototypes.push_back(prototype);
      classes.push_back(asset_class);
    }
  std::size_t right = 0;
  for (std::size_t i = 0; i < samples.count(); ++i)
    right += classes[nearest_of(prototypes, samples.codes[i])] == samples.classes[i];
  return static_cast<double>(right) / static_cast<double>(samples.count());
}

}  // namespace cloam
