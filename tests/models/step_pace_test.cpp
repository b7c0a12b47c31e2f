// What is told of the steps that are left, against sums of made-up steps.
#include "models/train/step_pace.h"

#include <doctest/doctest.h>

#include <cmath>

using namespace cloam;

namespace {

StepPace pace_of(int64_t steps, const auto& seconds) {
  StepPace pace;
  for (int64_t i = 1; i <= steps; i++) pace.add(seconds(i));
  return pace;
}

double sum_of(int64_t first, int64_t last, const auto& seconds) {
  double sum = 0;
  for (int64_t i = first; i <= last; i++) sum += seconds(i);
  return sum;
}

}  // namespace

TEST_CASE("pace: nothing is told before five steps") {
  CHECK(!pace_of(4, [](int64_t) { return 1.0; }).seconds_for(10, 0));
  CHECK(pace_of(5, [](int64_t) { return 1.0; }).seconds_for(10, 0) == doctest::Approx(10));
  CHECK(pace_of(5, [](int64_t) { return 1.0; }).seconds_for(0, 0) == doctest::Approx(0));
}

TEST_CASE("pace: steps that get slower until the model has grown") {
  const auto seconds = [](int64_t i) { return 0.02 + 1e-5 * static_cast<double>(std::min<int64_t>(i, 2000)); };
  const StepPace pace = pace_of(1000, seconds);
  CHECK(*pace.seconds_for(3000, 1000) == doctest::Approx(sum_of(1001, 4000, seconds)).epsilon(0.01));
  CHECK(*pace.seconds_for(500, 1000) == doctest::Approx(sum_of(1001, 1500, seconds)).epsilon(0.01));
}

TEST_CASE("pace: steps that got quicker stay as quick as the last ones") {
  const auto seconds = [](int64_t i) { return 0.01 + 0.1 * std::exp(-static_cast<double>(i) / 50); };
  CHECK(*pace_of(1000, seconds).seconds_for(4000, 0) == doctest::Approx(40).epsilon(0.01));
  CHECK(*pace_of(1000, seconds).seconds_for(4000, 2000) == doctest::Approx(40).epsilon(0.01));
}

TEST_CASE("the slowest of several ranks: the mean of all ways in which they can draw their times") {
  const std::vector<double> seconds = {3, 1, 2};
  CHECK(mean_of_largest(seconds, 1) == doctest::Approx(2));
  double of_two = 0, of_three = 0;
  for (const double a : seconds)
    for (const double b : seconds) {
      of_two += std::max(a, b) / 9;
      for (const double c : seconds) of_three += std::max({a, b, c}) / 27;
    }
  CHECK(mean_of_largest(seconds, 2) == doctest::Approx(of_two));
  CHECK(mean_of_largest(seconds, 3) == doctest::Approx(of_three));
}
