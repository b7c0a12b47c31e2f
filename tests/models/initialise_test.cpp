// The gaussians that a training begins with, against distances to all points.
#include "models/gaussians/initialise.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "runtime/error.h"

using namespace cloam;

namespace {

// Half the logarithm of the mean squared distance to the three nearest others.
double scale_by_all_distances(const PointCloud& cloud, std::size_t point) {
  std::vector<double> squares;
  for (std::size_t other = 0; other < cloud.count(); ++other) {
    double sum = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      sum += std::pow(double(cloud.positions[3 * point + axis]) - double(cloud.positions[3 * other + axis]), 2);
    }
    if (other != point) squares.push_back(sum);
  }
  std::sort(squares.begin(), squares.end());
  const std::size_t count = std::min<std::size_t>(3, squares.size());
  double mean = 0;
  for (std::size_t i = 0; i < count; ++i) mean += squares[i] / double(count);
  return 0.5 * std::log(std::max(mean, 1e-7));
}

PointCloud cloud_of(std::size_t count, const auto& place) {
  PointCloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    for (const float value : place(i)) cloud.positions.push_back(value);
    for (int c = 0; c < 3; ++c) cloud.colours.push_back(std::uint8_t(i));
  }
  return cloud;
}

void check_all(const PointCloud& cloud) {
  const Gaussians gaussians = gaussians_from_points(cloud);
  REQUIRE(gaussians.count() == cloud.count());
  CHECK(gaussians.means == cloud.positions);
  for (std::size_t i = 0; i < cloud.count(); ++i) {
    const double want = scale_by_all_distances(cloud, i);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      CHECK(double(gaussians.scales[3 * i + axis]) == doctest::Approx(want).epsilon(1e-6));
    }
  }
}

}  // namespace

TEST_CASE("gaussians from points: deviations are those of all distances") {
  std::mt19937 random(3);
  std::normal_distribution<float> normal;
  using Place = std::array<float, 3>;
  check_all(cloud_of(1500, [&](std::size_t) { return Place{normal(random), 10 * normal(random), normal(random)}; }));
  // Clusters far apart, a plane, a grid of ties, points at one place.
  check_all(cloud_of(600, [&](std::size_t i) {
    const float far = i % 3 == 0 ? 1000.f : 0.f;
    return Place{far + 0.01f * normal(random), normal(random), 0};
  }));
  check_all(cloud_of(343, [](std::size_t i) { return Place{float(i % 7), float(i / 7 % 7), float(i / 49)}; }));
  check_all(cloud_of(100, [](std::size_t i) { return Place{float(i / 20), 0, 0}; }));
  for (std::size_t count = 0; count < 12; ++count) {
    check_all(cloud_of(count, [&](std::size_t) { return Place{normal(random), normal(random), normal(random)}; }));
  }
}

TEST_CASE("gaussians from points: opacity, rotation and colour") {
  PointCloud cloud{{0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3}, {0, 51, 255, 1, 2, 3, 4, 5, 6, 7, 8, 9}};
  const Gaussians gaussians = gaussians_from_points(cloud);
  CHECK(double(gaussians.scales[0]) == doctest::Approx(0.5 * std::log((1.0 + 4 + 9) / 3)));
  CHECK(1 / (1 + std::exp(-double(gaussians.opacities[1]))) == doctest::Approx(0.1));
  CHECK(std::vector<float>(gaussians.rotations.begin() + 4, gaussians.rotations.begin() + 8) ==
        std::vector<float>{1, 0, 0, 0});
  for (std::size_t c = 0; c < 3; ++c) {
    CHECK(0.5 + 0.28209479177387814 * double(gaussians.sh_first[c]) == doctest::Approx(cloud.colours[c] / 255.0));
  }
  CHECK(gaussians.sh_rest == std::vector<float>(4 * 45, 0.f));
  cloud.positions[4] = std::numeric_limits<float>::infinity();
  CHECK_THROWS_AS(gaussians_from_points(cloud), Error);
}
