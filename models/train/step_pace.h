// How long the steps that are left will take, told from those that were made.
#pragma once
#include <cstdint>
#include <optional>
#include <vector>

namespace cloam {

/// Steps change their cost as scenes do: what counts are the last of them, and how they got slower while the model
/// still grows.
class StepPace {
 public:
  void add(double seconds) { seconds_.push_back(static_cast<float>(seconds)); }

  /// Of the next `steps`, the first `growing` of which go on getting slower as the last ones did. The level is the mean
  /// of the last quarter of all steps (at most 200), the slope the difference of their halves (at most 1,000 steps).
  /// None before five steps.
  std::optional<double> seconds_for(int64_t steps, int64_t growing) const;

 private:
  double mean_of(int64_t last, int64_t before) const;
  std::vector<float> seconds_;
};

/// The mean of the largest of `count` values that are drawn from these, each as likely as the others: how long the
/// slowest of `count` ranks takes.
double mean_of_largest(std::vector<double> values, int64_t count);

}  // namespace cloam
