// Strategies of growth on gaussians made by hand, and the optimiser's state that follows them.
#include "models/splat/growth.h"

#include <doctest/doctest.h>

#include <cmath>

#include "models/io/tensors.h"
#include "models/train/optimiser.h"
#include "runtime/error.h"

using namespace cloam;

namespace {

/// Round gaussians in a row; opacities by logit, deviations as given.
Gaussians row_of(const std::vector<double>& deviations, const std::vector<double>& opacities) {
  Gaussians g;
  for (size_t i = 0; i < deviations.size(); i++) {
    g.means.insert(g.means.end(), {static_cast<float>(i), 0, 0});
    g.scales.insert(g.scales.end(), 3, static_cast<float>(std::log(deviations[i])));
    g.rotations.insert(g.rotations.end(), {1, 0, 0, 0});
    g.opacities.push_back(static_cast<float>(std::log(opacities[i] / (1 - opacities[i]))));
    g.sh_first.insert(g.sh_first.end(), 3, 0.1f * static_cast<float>(i));
    g.sh_rest.insert(g.sh_rest.end(), 45, 0.f);
  }
  return g;
}

double opacity(const Gaussians& g, size_t i) { return 1 / (1 + std::exp(-double{g.opacities[i]})); }

constexpr Progress kGrowthStep{600, 30000, 5};
const CameraRegion kCameras{Eigen::Vector3d::Zero(), 10};

}  // namespace

TEST_CASE("growth: the paper's rules, gaussian by gaussian") {
  GrowthOptions options;
  const auto growth = make_growth(options, kCameras);  // 0.1 and more is large
  Gaussians g = row_of({0.05, 0.05, 0.5, 0.5, 0.05}, {0.5, 0.5, 0.5, 0.5, 0.001});
  const GrowthMoves moves = growth->grow(g, {{0.f, 1e-3f, 0.f, 1e-3f, 1e-3f}}, kGrowthStep);
  // 0 and 2 stay, 1 is doubled, 3 becomes two smaller ones, 4 is too faint to live.
  CHECK(moves.source == std::vector<int32_t>{0, 1, 2, -1, -1, -1});
  CHECK(moves.parent == std::vector<int32_t>{0, 1, 2, 1, 3, 3});
  REQUIRE(g.count() == 6);
  CHECK(g.means[3 * 3] == 1.f);
  CHECK(g.scales[3 * 3] == doctest::Approx(std::log(0.05)));
  for (const size_t half : {size_t{4}, size_t{5}}) {
    CHECK(g.scales[3 * half] == doctest::Approx(std::log(0.5 / 1.6)));
    CHECK(std::abs(double{g.means[3 * half]} - 3) > 1e-4);
    CHECK(std::abs(double{g.means[3 * half]} - 3) < 2.5);  // 5 deviations
    CHECK(g.sh_first[3 * half] == doctest::Approx(0.3));
  }
  CHECK(!moves.opacities_reset);
  CHECK(opacity(g, 0) == doctest::Approx(0.5));
  for (const size_t doubled : {1, 3}) CHECK(1 - std::pow(1 - opacity(g, doubled), 2) == doctest::Approx(0.5));
  CHECK(!growth->due({500, 30000, 5}));
  CHECK(growth->due({600, 30000, 5}));
  CHECK(!growth->due({15100, 30000, 5}));
  CHECK(!growth->due({1100, 2000, 5}));  // the second half of a short training
}

TEST_CASE("growth: no more gaussians than allowed, those with the largest gradients") {
  GrowthOptions options;
  options.max_count = 5;
  Gaussians g = row_of({0.05, 0.05, 0.05, 0.05}, {0.5, 0.5, 0.5, 0.5});
  const GrowthMoves moves = make_growth(options, kCameras)->grow(g, {{1e-3f, 5e-3f, 2e-3f, 3e-3f}}, kGrowthStep);
  CHECK(g.count() == 5);
  CHECK(g.means[3 * 4] == 1.f);
  CHECK(moves.source.back() == -1);
}

TEST_CASE("growth: after a reset what is large goes, unless it is far away") {
  GrowthOptions options;
  Gaussians g = row_of({1.5, 0.05, 1.5}, {0.5, 0.5, 0.5});
  g.means[3 * 2] = 20;  // twice the cameras' radius from their middle
  CHECK(make_growth(options, kCameras)->grow(g, {{0.f, 0.f, 0.f}}, {3100, 30000, 5}).source ==
        std::vector<int32_t>{1, 2});
}

TEST_CASE("growth: opacities begin again") {
  GrowthOptions options;
  Gaussians g = row_of({0.05, 0.05}, {0.5, 0.007});
  CHECK(make_growth(options, kCameras)->grow(g, {{0.f, 0.f}}, {3000, 30000, 5}).opacities_reset);
  CHECK(opacity(g, 0) == doctest::Approx(0.01));
  CHECK(opacity(g, 1) == doctest::Approx(0.007));
}

TEST_CASE("growth: several gaussians in one place look like the one that they were") {
  for (const double whole : {0.1, 0.5, 0.95}) {
    for (const int count : {2, 3, 7}) {
      const Shared shared = shared_among(whole, count);
      CHECK(1 - std::pow(1 - shared.opacity, count) == doctest::Approx(whole));
      // The integral of what a line through the middle sees: of one of deviation 1, and of `count` narrower ones.
      double one = 0, all = 0;
      for (double x = -8; x < 8; x += 0.01) {
        one += 0.01 * whole * std::exp(-0.5 * x * x);
        const double narrow = std::exp(-0.5 * x * x / (shared.scale * shared.scale));
        all += 0.01 * (1 - std::pow(1 - shared.opacity * narrow, count));
      }
      CHECK(all == doctest::Approx(one).epsilon(1e-6));
    }
  }
}

TEST_CASE("growth: Markov chain Monte Carlo moves the faint to the opaque") {
  GrowthOptions options;
  options.strategy = "mcmc";
  options.max_count = 3;
  Gaussians g = row_of({0.1, 0.1, 0.1}, {0.9, 0.001, 0.0012});
  const GrowthMoves moves = make_growth(options, kCameras)->grow(g, {}, kGrowthStep);
  REQUIRE(g.count() == 3);
  const Shared shared = shared_among(0.9, 3);
  for (size_t i = 0; i < 3; i++) {
    CHECK(g.means[3 * i] == 0.f);
    CHECK(opacity(g, i) == doctest::Approx(shared.opacity).epsilon(1e-4));
    CHECK(std::exp(double{g.scales[3 * i]}) == doctest::Approx(0.1 * shared.scale).epsilon(1e-4));
  }
  CHECK(moves.source == std::vector<int32_t>{-1, -1, -1});
  options.max_count = 100;
  Gaussians grown = row_of(std::vector<double>(40, 0.1), std::vector<double>(40, 0.5));
  make_growth(options, kCameras)->grow(grown, {}, kGrowthStep);
  CHECK(grown.count() == 42);  // 5 % more
  options.max_count = 40;
  Gaussians enough = row_of(std::vector<double>(40, 0.1), std::vector<double>(40, 0.5));
  CHECK(!make_growth(options, kCameras)->grow(enough, {}, kGrowthStep).any());
  CHECK_THROWS_AS(make_growth({.strategy = "mcm"}, kCameras), Error);
}

TEST_CASE("growth: moments of the optimiser move with their rows, new ones begin at zero") {
  Params params = {{"moved", parameter({1, 2, 3, 4, 5, 6}, {3, 2})}, {"other", parameter({7}, {1})}};
  const ParameterGroups rates = {{"", 0.1f}};
  Optimiser optimiser(params, rates);
  optimiser.step(params,
                 {from_host(std::vector<float>{1, 2, 3, 4, 5, 6}, {3, 2}), from_host(std::vector<float>{9}, {1})},
                 rates, {1});
  const TensorMap before = optimiser.state();
  params["moved"] = parameter({0, 0, 0, 0, 0, 0, 0, 0}, {4, 2});
  optimiser.move_rows(params, {{"moved", {2, -1, 0, 2}}}, rates);
  const TensorMap after = optimiser.state();
  for (const char* moment : {"m.", "v."}) {
    const std::string name = std::string(moment) + "moved";
    const auto old = values_from<float>(before, name, {3, 2}), now = values_from<float>(after, name, {4, 2});
    CHECK(old[4] != 0.f);
    CHECK(now == std::vector<float>{old[4], old[5], 0, 0, old[0], old[1], old[4], old[5]});
    CHECK(after.at(std::string(moment) + "other") == before.at(std::string(moment) + "other"));
  }
}
