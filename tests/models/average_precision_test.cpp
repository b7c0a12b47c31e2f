// Average precision by hand-made cases whose values follow from its definition.
#include "models/metrics/average_precision.h"

#include <doctest/doctest.h>

#include <cmath>

#include "tests/models/errors.h"

using namespace cloam;

namespace {

/// Boxes 10 m apart, `count` in each of two samples.
std::vector<TrueBox> row_of_boxes(int count) {
  std::vector<TrueBox> boxes;
  for (int i = 0; i < 2 * count; i++) boxes.push_back({i % 2, {10.0 * (i / 2), 5}});
  return boxes;
}

std::vector<DetectedBox> found(const std::vector<TrueBox>& boxes, const Eigen::Vector2d& shift = {0, 0}) {
  std::vector<DetectedBox> all;
  for (const TrueBox& box : boxes) all.push_back({box.sample, box.centre + shift, 1 - 0.01 * double(all.size())});
  return all;
}

}  // namespace

TEST_CASE("average precision: 1 for what is perfect, 0 for nothing found, none without truth") {
  const auto truth = row_of_boxes(5);
  const DistancePrecision perfect = distance_precision(found(truth), truth);
  REQUIRE(perfect.at.size() == 3);
  for (const double at : perfect.at) CHECK(at == doctest::Approx(1).epsilon(1e-12));
  CHECK(perfect.mean == doctest::Approx(1).epsilon(1e-12));
  CHECK(average_precision({}, truth, 4) == 0);
  CHECK(average_precision({{7, {0, 5}, 1}}, truth, 4) == 0);  // another sample's box
  CHECK(std::isnan(average_precision(found(truth), {}, 4)));
  CHECK(std::isnan(average_precision({}, {}, 4)));
}

TEST_CASE("average precision: boxes 1.5 m off are wrong at 1 m and right at 2 m") {
  const auto truth = row_of_boxes(5);
  const DistancePrecision shifted = distance_precision(found(truth, {0, 1.5}), truth);
  REQUIRE(shifted.at.size() == 3);
  CHECK(shifted.at[0] == 0);
  CHECK(shifted.at[1] == doctest::Approx(1).epsilon(1e-12));
  CHECK(shifted.at[2] == doctest::Approx(1).epsilon(1e-12));
  CHECK(shifted.mean == doctest::Approx(2 / 3.0));
  CHECK(average_precision(found(truth, {0, 1.5}), truth, 1.5) == 0);  // at the distance itself: not below it
}

TEST_CASE("average precision: a box that is found twice is a false alarm the second time") {
  const auto truth = row_of_boxes(5);
  auto detected = found(truth);
  for (const DetectedBox& box : found(truth)) detected.push_back({box.sample, box.centre, box.score - 0.005});
  // Right and wrong take turns. Below its last recall precision is linear between steps: after n boxes found it is
  // n / (2n - 1) and, once the second box of that place is seen, n / 2n; of equal recalls the last counts.
  const auto curve = precision_curve(detected, truth, 1);
  CHECK(curve[0] == 1);
  CHECK(curve[20] == doctest::Approx(0.5));
  CHECK(curve[15] == doctest::Approx(0.5 + 0.5 * (2 / 3.0 - 0.5)));  // halfway from 1/2 at 0.1 to 2/3 at 0.2
  CHECK(average_precision(detected, truth, 1) < 0.6);
  // The surest of two takes the box, and the other one may take the next nearest that is near enough.
  const std::vector<TrueBox> near = {{0, {0, 0}}, {0, {3, 0}}};
  const std::vector<DetectedBox> both = {{0, {0.1, 0}, 0.5}, {0, {0, 0}, 0.9}};
  CHECK(average_precision(both, near, 4) == doctest::Approx(1).epsilon(1e-12));
  CHECK(average_precision(both, near, 2) < 0.6);
}

TEST_CASE("average precision: a curve by hand") {
  // Four boxes; by falling score: right, wrong, right, right, wrong. Recall 1/4, 1/4, 2/4, 3/4, 3/4; precision 1, 1/2,
  // 2/3, 3/4, 3/5.
  const std::vector<TrueBox> truth = {{0, {0, 0}}, {0, {20, 0}}, {0, {40, 0}}, {0, {60, 0}}};
  const std::vector<DetectedBox> detected = {
      {0, {60, 1}, 0.2}, {0, {0, 0}, 0.9}, {0, {20, 8}, 0.8}, {0, {20, 0}, 0.7}, {0, {40, 99}, 0.1}};
  const auto curve = precision_curve(detected, truth, 2);
  double sum = 0;
  for (int i = 0; i <= 100; i++) {
    const double recall = i * 0.01;
    double want = 0;
    if (i < 25)
      want = 1;
    else if (i <= 50)
      want = 0.5 + (2 / 3.0 - 0.5) * (recall - 0.25) / 0.25;
    else if (i < 75)
      want = 2 / 3.0 + (0.75 - 2 / 3.0) * (recall - 0.5) / 0.25;
    else if (i == 75)
      want = 0.6;
    CAPTURE(i);
    CHECK(curve[static_cast<size_t>(i)] == doctest::Approx(want).epsilon(1e-12));
    if (i > 10) sum += std::max(0.0, want - 0.1);
  }
  CHECK(average_precision(detected, truth, 2) == doctest::Approx(sum / 90 / 0.9).epsilon(1e-12));
}

TEST_CASE("average precision: precision below a tenth counts as nothing") {
  // One box among twenty false alarms that are surer: 1/21.
  std::vector<DetectedBox> detected = {{0, {0, 0}, 0.1}};
  for (int i = 0; i < 20; i++) detected.push_back({0, {100.0 + i, 0}, 0.9});
  CHECK(average_precision(detected, {{0, {0, 0}}}, 1) == 0);
  CHECK(precision_curve(detected, {{0, {0, 0}}}, 1)[100] == doctest::Approx(1 / 21.0));
}

TEST_CASE("average precision: of equal scores the last counts first, and what is not finite is refused") {
  const std::vector<TrueBox> truth = {{0, {0, 0}}};
  CHECK(average_precision({{0, {50, 0}, 0.5}, {0, {0, 0}, 0.5}}, truth, 1) > 0.99);
  CHECK(average_precision({{0, {0, 0}, 0.5}, {0, {50, 0}, 0.5}}, truth, 1) < 0.5);
  CHECK(holds(error_of([&] { average_precision({{0, {0, 0}, NAN}}, truth, 1); }), "score is not finite"));
  CHECK(holds(error_of([&] { average_precision({}, {{0, {INFINITY, 0}}}, 1); }), "centre is not finite"));
}
