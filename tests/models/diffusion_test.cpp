// The diffusion core against closed forms: schedules, steps, and samples where the exact denoiser is
// known.
#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "models/diffusion/sampler.h"
#include "models/nn/ema.h"
#include "runtime/error.h"

using namespace cloam;

namespace {

/// Ho et al. 2020, appendix: written once more with betas.
double beta_before(const NoiseSchedule& schedule, int64_t t) {
  const double now = schedule.level(t).alpha, before = schedule.level(t - 1).alpha;
  return 1 - now * now / (before * before);
}

double kept_at(const NoiseSchedule& schedule, int64_t t) { return std::pow(schedule.level(t).alpha, 2); }

using Point = std::array<double, 2>;

/// A mixture of round Gaussians of one width in the plane.
struct Mixture {
  std::vector<Point> modes;
  std::vector<double> shares;
  double deviation;

  /// E[x | x_t] (the mean of the posterior): each mode's own, weighted by how likely it is.
  Point clean(const Point& noisy, const Level& level) const {
    const double variance = std::pow(level.alpha * deviation, 2) + level.sigma * level.sigma;
    std::vector<double> logs;
    for (size_t m = 0; m < modes.size(); m++) {
      double squares = 0;
      for (size_t k = 0; k < 2; k++) squares += std::pow(noisy[k] - level.alpha * modes[m][k], 2);
      logs.push_back(std::log(shares[m]) - squares / (2 * variance));
    }
    const double most = *std::max_element(logs.begin(), logs.end());
    Point sum = {0, 0};
    double weights = 0;
    for (size_t m = 0; m < modes.size(); m++) {
      const double weight = std::exp(logs[m] - most), gain = level.alpha * deviation * deviation / variance;
      weights += weight;
      for (size_t k = 0; k < 2; k++) sum[k] += weight * (modes[m][k] + gain * (noisy[k] - level.alpha * modes[m][k]));
    }
    return {sum[0] / weights, sum[1] / weights};
  }
};

/// The exact denoiser: v = (alpha x_t - x^) / sigma.
Denoiser exact(const Mixture& mixture, const NoiseSchedule& schedule) {
  return [&](const Tensor& noisy, int64_t t) {
    const std::vector<float> from = noisy.to_host();
    std::vector<float> out(from.size());
    for (size_t i = 0; i < from.size(); i += 2) {
      const Point x =
          mixture.clean({static_cast<double>(from[i]), static_cast<double>(from[i + 1])}, schedule.level(t));
      for (size_t k = 0; k < 2; k++) out[i + k] = static_cast<float>(x[k]);
    }
    const Level level = schedule.level(t);
    return noisy * (level.alpha / level.sigma) - from_host(out, noisy.shape()) * (1 / level.sigma);
  };
}

}  // namespace

TEST_CASE("schedules keep of the signal what their papers say") {
  const NoiseSchedule linear, cosine(Betas::cosine), scaled(Betas::scaled_linear);
  CHECK(kept_at(linear, 0) == doctest::Approx(1 - 1e-4));
  CHECK(kept_at(linear, 999) == doctest::Approx(4.0358e-5).epsilon(1e-3));  // Ho et al.: L_T near 0
  CHECK(kept_at(scaled, 0) == doctest::Approx(1 - 0.00085));
  CHECK(kept_at(scaled, 999) == doctest::Approx(0.00466).epsilon(1e-3));  // of Stable Diffusion
  CHECK(beta_before(linear, 999) == doctest::Approx(0.02));
  CHECK(beta_before(scaled, 999) == doctest::Approx(0.012));
  const auto f = [](double along) { return std::pow(std::cos((along + 0.008) / 1.008 * M_PI / 2), 2); };
  for (const int64_t t : {0, 400, 990}) {
    CAPTURE(t);
    CHECK(kept_at(cosine, t) == doctest::Approx(f((static_cast<double>(t) + 1) / 1000) / f(0)).epsilon(1e-9));
  }
  CHECK(beta_before(cosine, 999) == doctest::Approx(0.999));
  CHECK(cosine.level(-1).alpha == 1);
  CHECK(betas_named("scaled-linear") == Betas::scaled_linear);
  CHECK_THROWS_AS(betas_named("quadratic"), Error);
  CHECK_THROWS_AS(NoiseSchedule(Betas::linear, 0), Error);
}

TEST_CASE("what is clean follows from the velocities that are trained") {
  const NoiseSchedule schedule;
  const Tensor x = random_normal({2, 3, 4, 4}, {1}), e = random_normal({2, 3, 4, 4}, {2});
  for (const int32_t t : {60, 200, 999}) {
    const Tensor times = from_host(std::vector<int32_t>{t, t}, {2});
    const Tensor clean = schedule.clean(schedule.noisy(x, e, times), schedule.velocity(x, e, times), times);
    CHECK(max(abs(clean - x)).item() < 5e-6f);
  }
}

TEST_CASE("each sample of a batch has its own time") {
  const NoiseSchedule schedule;
  const Tensor times = from_host(std::vector<int32_t>{0, 999}, {2});
  const std::vector<float> noisy = schedule.noisy(ones({2, 1}), zeros({2, 1}), times).to_host();
  CHECK(noisy[0] == doctest::Approx(0.99995));
  CHECK(noisy[1] == doctest::Approx(0.00635).epsilon(1e-3));
  const std::vector<float> v = schedule.velocity(ones({2, 1}), zeros({2, 1}), times).to_host();
  CHECK(v[0] == doctest::Approx(-0.01));
  CHECK(v[1] == doctest::Approx(-0.99998));
}

TEST_CASE("a step of DDIM that knows x leads to x at the next level, with the noise it had") {
  const NoiseSchedule schedule;
  const double x = 0.4, e = 1.7;
  for (const int64_t to : {-1, 10, 600}) {
    const Level from = schedule.level(800), level = schedule.level(to);
    const DenoisingStep step = ddim_step(from, level);
    CHECK(step.noisy * (from.alpha * x + from.sigma * e) + step.clean * x ==
          doctest::Approx(level.alpha * x + level.sigma * e));
  }
}

TEST_CASE("DDIM with the exact denoiser of a mixture reaches its modes, each as often as it is likely") {
  const Mixture mixture = {{{-1.5, 0.5}, {1, 1.2}, {0.6, -1.6}}, {0.5, 0.3, 0.2}, 0.02};
  const int64_t count = 1024;
  const Tensor start = random_normal({count, 2}, {5});
  for (const Betas betas : {Betas::linear, Betas::cosine}) {
    const NoiseSchedule schedule(betas);
    const std::vector<float> samples = sample(schedule, exact(mixture, schedule), start, 50).to_host();
    double error = 0;
    std::vector<double> found(3);
    for (size_t i = 0; i < samples.size(); i += 2) {
      std::vector<double> distances;
      for (const Point& mode : mixture.modes)
        distances.push_back(
            std::hypot(static_cast<double>(samples[i]) - mode[0], static_cast<double>(samples[i + 1]) - mode[1]));
      const auto nearest = std::min_element(distances.begin(), distances.end());
      error += *nearest / static_cast<double>(count);
      found[static_cast<size_t>(nearest - distances.begin())] += 1 / static_cast<double>(count);
    }
    CAPTURE(error);
    CHECK(error < 0.05);
    for (size_t m = 0; m < 3; m++) CHECK(found[m] == doctest::Approx(mixture.shares[m]).epsilon(0.2));
  }
}

TEST_CASE("sampling begins at the last time") {
  CHECK(sampling_timesteps(1000, 4) == std::vector<int64_t>{999, 749, 499, 249});
  CHECK(sampling_timesteps(3, 3) == std::vector<int64_t>{2, 1, 0});
  CHECK_THROWS_AS(sampling_timesteps(10, 11), Error);
  CHECK_THROWS_AS(sampling_timesteps(10, 0), Error);
}

TEST_CASE("guidance goes on from what no condition says through what the condition says") {
  int without_calls = 0;
  const Denoiser with = [](const Tensor& x, int64_t t) { return x * 3.f + static_cast<float>(t); };
  const Denoiser without = [&](const Tensor& x, int64_t) {
    without_calls++;
    return x;
  };
  const Tensor x = from_host(std::vector<float>{2, -1}, {2});
  CHECK(guided(with, without, 2.5f)(x, 7).to_host() == std::vector<float>{2 + 2.5f * (13 - 2), -1 + 2.5f * (4 + 1)});
  CHECK(guided(with, without, 0.f)(x, 7).to_host() == x.to_host());
  CHECK(without_calls == 2);
  CHECK(guided(with, without, 1.f)(x, 7).to_host() == std::vector<float>{13, 4});
  CHECK(without_calls == 2);
}

TEST_CASE("min-SNR weights by hand") {
  const NoiseSchedule schedule;
  const std::vector<int32_t> times = {0, 500, 999};
  const std::vector<float> weights = schedule.min_snr_weights(5, from_host(times, {3})).to_host();
  for (size_t i = 0; i < 3; i++) {
    const double kept = kept_at(schedule, times[i]), ratio = kept / (1 - kept);
    CHECK(weights[i] == doctest::Approx(std::min(ratio, 5.0) / (ratio + 1)).epsilon(1e-4));
  }
}

TEST_CASE("averages of parameters forget by their decay, quickly in the first steps") {
  Params now, average;
  now["w"] = parameter({1, 2}, {2}), average["w"] = parameter({5, 0}, {2});
  update_ema(average, now, 0.75);
  CHECK(average["w"].to_host() == std::vector<float>{4, 0.5f});
  update_ema(average, now, 0.5);
  CHECK(average["w"].to_host() == std::vector<float>{2.5f, 1.25f});
  CHECK(now["w"].to_host() == std::vector<float>{1, 2});
  CHECK(warm_decay(0.9999, 1) == doctest::Approx(2.0 / 11));
  CHECK(warm_decay(0.9999, 90) == doctest::Approx(0.91));
  CHECK(warm_decay(0.999, 1000000) == 0.999);
}
