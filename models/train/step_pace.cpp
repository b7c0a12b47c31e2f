// See step_pace.h.
#include "models/train/step_pace.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace cloam {
namespace {

constexpr int64_t kLeast = 5, kMaxOfLevel = 200, kMaxOfSlope = 500;

}  // namespace

/// Of the `last` steps before the newest `before`.
double StepPace::mean_of(int64_t last, int64_t before) const {
  const auto end = seconds_.end() - static_cast<std::ptrdiff_t>(before);
  return std::accumulate(end - static_cast<std::ptrdiff_t>(last), end, 0.0) / static_cast<double>(last);
}

std::optional<double> StepPace::seconds_for(int64_t steps, int64_t growing) const {
  const auto made = static_cast<int64_t>(seconds_.size());
  if (made < kLeast) return std::nullopt;
  const int64_t few = std::clamp<int64_t>(made / 4, 1, kMaxOfLevel), half = std::min(made / 2, kMaxOfSlope);
  const double level = mean_of(few, 0);
  const double rise = std::max(0.0, (mean_of(half, 0) - mean_of(half, half)) / static_cast<double>(half));
  const auto rising = static_cast<double>(std::clamp<int64_t>(growing, 0, steps)), all = static_cast<double>(steps);
  const double now = rising > 0 ? level + rise * static_cast<double>(few) / 2 : level;
  return now * all + rise * rising * (all - rising / 2);
}

double mean_of_largest(std::vector<double> values, int64_t count) {
  std::sort(values.begin(), values.end());
  const auto none_above = [&](size_t i) {  // the probability that all are among the first i
    return std::pow(static_cast<double>(i) / static_cast<double>(values.size()), count);
  };
  double sum = 0;
  for (size_t i = 0; i < values.size(); ++i) sum += values[i] * (none_above(i + 1) - none_above(i));
  return sum;
}

}  // namespace cloam
