// The Chamfer distance against all pairs of points.
#include "models/metrics/chamfer.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "tests/models/errors.h"

using namespace cloam;

namespace {

using Values = std::vector<float>;

/// Points near a few planes, as of a street, with some far out and some twice.
Values cloud(int count, unsigned seed) {
  std::mt19937 random(seed);
  const auto number = [&](float size) { return size * (static_cast<float>(random() % 10001) / 5000.f - 1); };
  Values points;
  for (int i = 0; i < count; i++) {
    if (i % 7 == 3 && i > 7) {
      points.insert(points.end(), {points[0], points[1], points[2]});
      continue;
    }
    const float far = i % 50 == 0 ? 2000.f : 40.f;
    points.insert(points.end(), {number(far), i % 3 == 0 ? 4.f : number(10), i % 2 == 0 ? 0.f : number(3)});
  }
  return points;
}

double sum_by_pairs(const Values& from, const Values& to) {
  double sum = 0;
  for (size_t i = 0; i < from.size(); i += 3) {
    double best = std::numeric_limits<double>::infinity();
    for (size_t j = 0; j < to.size(); j += 3) {
      double squared = 0;
      for (size_t axis = 0; axis < 3; axis++) squared += std::pow(double{from[i + axis]} - double{to[j + axis]}, 2);
      best = std::min(best, squared);
    }
    sum += best;
  }
  return sum;
}

}  // namespace

TEST_CASE("chamfer: the sums over all pairs, for sets of any size") {
  for (const int count : {1, 2, 3, 17, 400}) {
    const Values a = cloud(count, 1), b = cloud(count * 3 / 2, 2);
    const ChamferSums sums = chamfer(a, b);
    CAPTURE(count);
    CHECK(sums.of_a == doctest::Approx(sum_by_pairs(a, b)).epsilon(1e-12));
    CHECK(sums.of_b == doctest::Approx(sum_by_pairs(b, a)).epsilon(1e-12));
    CHECK(sums.count_a == static_cast<size_t>(count));
    CHECK(sums.count_b == static_cast<size_t>(count * 3 / 2));
    CHECK(chamfer(a, a).by_target() == 0);
  }
}

TEST_CASE("chamfer: its two forms by hand") {
  // From a: 1 and 4; from b: 1.
  const ChamferSums sums = chamfer(Values{0, 0, 0, 0, 3, 0}, Values{0, 1, 0});
  CHECK(sums.by_target() == 1 + 4 + 1);
  CHECK(sums.symmetric() == 2.5 + 1);
}

TEST_CASE("chamfer: an empty set is infinitely far, and what is no list of points is refused") {
  CHECK(std::isinf(chamfer({}, Values{1, 2, 3}).by_target()));
  CHECK(holds(error_of([] { chamfer(Values{1, 2}, {}); }), "got 2 values"));
  CHECK(holds(error_of([] { chamfer(Values{1, 2, 3, NAN, 1, 1}, {}); }), "point 1 is not finite"));
}
