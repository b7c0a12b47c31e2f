// The diffusion core against closed forms: schedules, conversions, steps, and samples where the exact denoiser is
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

constexpr Prediction kKinds[] = {Prediction::noise, Prediction::clean, Prediction::velocity};
constexpr Betas kBetas[] = {Betas::linear, Betas::cosine, Betas::scaled_linear};

/// Ho et al. 2020, appendix: written once more with betas.
double beta_before(const NoiseSchedule& schedule, int64_t t) {
  const double now = schedule.level(t).alpha, before = schedule.level(t - 1).alpha;
  return 1 - now * now / (before * before);
}

double kept_at(const NoiseSchedule& schedule, int64_t t) { return std::pow(schedule.level(t).alpha, 2); }

double truth_of(Prediction kind, double x, double e, const Level& level) {
  if (kind == Prediction::noise) return e;
  return kind == Prediction::clean ? x : level.alpha * e - level.sigma * x;
}

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

/// The exact denoiser, which says what it knows as a prediction of `kind`.
Denoiser exact(const Mixture& mixture, const NoiseSchedule& schedule, Prediction kind) {
  return [&, kind](const Tensor& noisy, int64_t t) {
    const std::vector<float> from = noisy.to_host();
    std::vector<float> out(from.size());
    for (size_t i = 0; i < from.size(); i += 2) {
      const Point x =
          mixture.clean({static_cast<double>(from[i]), static_cast<double>(from[i + 1])}, schedule.level(t));
      for (size_t k = 0; k < 2; k++) out[i + k] = static_cast<float>(x[k]);
    }
    return converted(noisy, from_host(out, noisy.shape()), Prediction::clean, kind, schedule.level(t));
  };
}

struct Moments {
  double mean = 0, variance = 0;
};

Moments moments_of(const std::vector<float>& values) {
  Moments out;
  const auto count = static_cast<double>(values.size());
  for (const float v : values) out.mean += static_cast<double>(v) / count;
  for (const float v : values) out.variance += std::pow(static_cast<double>(v) - out.mean, 2) / (count - 1);
  return out;
}

double largest_difference(const Tensor& a, const Tensor& b) { return static_cast<double>(max(abs(a - b)).item()); }

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

TEST_CASE("every prediction gives every other one at every time") {
  const double x = 0.7, e = -1.3;
  for (const Betas betas : kBetas) {
    const NoiseSchedule schedule(betas);
    for (int64_t t = 0; t < schedule.timesteps(); t++) {
      const Level level = schedule.level(t);
      const double noisy = level.alpha * x + level.sigma * e;
      for (const Prediction from : kKinds)
        for (const Prediction to : kKinds) {
          const Conversion by = conversion(from, to, level);
          const double got = by.noisy * noisy + by.predicted * truth_of(from, x, e, level);
          REQUIRE(std::abs(got - truth_of(to, x, e, level)) < 1e-6);
        }
    }
  }
}

TEST_CASE("conversions of tensors invert, from the targets that are trained") {
  const NoiseSchedule schedule;
  const Tensor x = random_normal({2, 3, 4, 4}, {1}), e = random_normal({2, 3, 4, 4}, {2});
  for (const int32_t t : {60, 200, 300}) {  // where neither alpha nor sigma is small: float32 has 24 bits
    const Tensor times = from_host(std::vector<int32_t>{t, t}, {2});
    const Tensor noisy = schedule.noisy(x, e, times);
    for (const Prediction from : kKinds)
      for (const Prediction to : kKinds) {
        const Tensor said = schedule.target(from, x, e, times);
        const Tensor other = converted(noisy, said, from, to, schedule.level(t));
        CHECK(largest_difference(other, schedule.target(to, x, e, times)) < 5e-6);
        CHECK(largest_difference(converted(noisy, other, to, from, schedule.level(t)), said) < 5e-6);
      }
  }
}

TEST_CASE("each sample of a batch has its own time") {
  const NoiseSchedule schedule;
  const Tensor times = from_host(std::vector<int32_t>{0, 999}, {2});
  const std::vector<float> noisy = schedule.noisy(ones({2, 1}), zeros({2, 1}), times).to_host();
  CHECK(noisy[0] == doctest::Approx(0.99995));
  CHECK(noisy[1] == doctest::Approx(0.00635).epsilon(1e-3));
  const std::vector<float> v = schedule.target(Prediction::velocity, ones({2, 1}), zeros({2, 1}), times).to_host();
  CHECK(v[0] == doctest::Approx(-0.01));
  CHECK(v[1] == doctest::Approx(-0.99998));
}

TEST_CASE("the steps of DDPM are its posterior, and DDIM with eta 1 takes the same") {
  const NoiseSchedule schedule;
  for (const int64_t t : {0, 1, 500, 999}) {
    const double beta = beta_before(schedule, t), now = kept_at(schedule, t), before = kept_at(schedule, t - 1);
    const DenoisingStep step = ddpm_step(schedule.level(t), schedule.level(t - 1));
    CHECK(step.clean == doctest::Approx(std::sqrt(before) * beta / (1 - now)));
    CHECK(step.noisy == doctest::Approx(std::sqrt(1 - beta) * (1 - before) / (1 - now)));
    CHECK(std::pow(step.deviation, 2) == doctest::Approx((1 - before) / (1 - now) * beta));
  }
  for (const int64_t to : {-1, 3, 400}) {
    const DenoisingStep a = ddpm_step(schedule.level(700), schedule.level(to)),
                        b = ddim_step(schedule.level(700), schedule.level(to), 1);
    CHECK(a.noisy == doctest::Approx(b.noisy));
    CHECK(a.clean == doctest::Approx(b.clean));
    CHECK(a.deviation == doctest::Approx(b.deviation));
  }
}

TEST_CASE("a step of DDIM that knows x leads to x at the next level, with the noise it had") {
  const NoiseSchedule schedule;
  const double x = 0.4, e = 1.7;
  for (const int64_t to : {-1, 10, 600}) {
    const Level from = schedule.level(800), level = schedule.level(to);
    const DenoisingStep step = ddim_step(from, level, 0);
    CHECK(step.deviation == 0);
    CHECK(step.noisy * (from.alpha * x + from.sigma * e) + step.clean * x ==
          doctest::Approx(level.alpha * x + level.sigma * e));
  }
}

TEST_CASE("DDIM with the exact denoiser of a mixture reaches its modes, each as often as it is likely") {
  const Mixture mixture = {{{-1.5, 0.5}, {1, 1.2}, {0.6, -1.6}}, {0.5, 0.3, 0.2}, 0.02};
  const int64_t count = 1024;
  const Tensor start = random_normal({count, 2}, {5});
  for (const Prediction kind : kKinds) {
    const NoiseSchedule schedule(kind == Prediction::noise ? Betas::cosine : Betas::linear);
    const std::vector<float> samples = sample(schedule, kind, exact(mixture, schedule, kind), start).to_host();
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

TEST_CASE("samples of DDPM have the moments that its steps give a Gaussian") {
  const NoiseSchedule schedule(Betas::linear, 200);
  const double mean = 0.8, deviation = 0.5;
  const Mixture one = {{{mean, mean}}, {1}, deviation};
  SamplerOptions options;
  options.steps = 200;
  options.eta = 1;
  options.key = {11};
  const int64_t count = 4096;
  const Tensor start = random_normal({count, 2}, {12});
  const Moments got = moments_of(
      sample(schedule, Prediction::noise, exact(one, schedule, Prediction::noise), start, options).to_host());
  // x^ is linear in x_t: mean and variance follow the chain of Ho et al., eq. 7, without any sampling.
  Moments want = {0, 1};
  for (int64_t t = 199; t >= 0; t--) {
    const double beta = beta_before(schedule, t), now = kept_at(schedule, t), before = kept_at(schedule, t - 1);
    const double gain = std::sqrt(now) * deviation * deviation / (now * deviation * deviation + 1 - now);
    const double of_x = std::sqrt(before) * beta / (1 - now), of_noisy = std::sqrt(1 - beta) * (1 - before) / (1 - now);
    const double by = of_noisy + of_x * gain;
    want.mean = by * want.mean + of_x * (mean - gain * std::sqrt(now) * mean);
    want.variance = by * by * want.variance + (1 - before) / (1 - now) * beta;
  }
  const auto values = static_cast<double>(2 * count);
  CAPTURE(got.mean);
  CAPTURE(want.mean);
  CAPTURE(got.variance);
  CAPTURE(want.variance);
  CHECK(std::abs(got.mean - want.mean) < 3 * std::sqrt(want.variance / values));
  CHECK(std::abs(got.variance - want.variance) < 3 * want.variance * std::sqrt(2 / values));
  CHECK(want.variance == doctest::Approx(deviation * deviation).epsilon(0.1));  // which are nearly the data's
}

TEST_CASE("sampling repeats with its key, draws nothing without eta, and begins at the last time") {
  const NoiseSchedule schedule;
  const Mixture wide = {{{0, 0}}, {1}, 1};
  const Denoiser denoiser = exact(wide, schedule, Prediction::velocity);
  const Tensor start = random_normal({8, 2}, {1});
  const auto with = [&](double eta, uint64_t seed) {
    SamplerOptions options;
    options.steps = 10, options.eta = eta, options.key = {seed};
    return sample(schedule, Prediction::velocity, denoiser, start, options).to_host();
  };
  CHECK(with(0, 1) == with(0, 2));
  CHECK(with(0.5, 1) == with(0.5, 1));
  CHECK(with(0.5, 1) != with(0.5, 2));
  CHECK(sampling_timesteps(1000, 4) == std::vector<int64_t>{999, 749, 499, 249});
  CHECK(sampling_timesteps(3, 3) == std::vector<int64_t>{2, 1, 0});
  CHECK_THROWS_AS(sampling_timesteps(10, 11), Error);
  CHECK_THROWS_AS(sampling_timesteps(10, 0), Error);
}

TEST_CASE("a clip bounds what is sampled") {
  const NoiseSchedule schedule;
  const Mixture far = {{{3, -3}}, {1}, 0.01};
  SamplerOptions options;
  options.steps = 10, options.clip = 1;
  const Tensor start = random_normal({4, 2}, {1});
  const std::vector<float> samples =
      sample(schedule, Prediction::clean, exact(far, schedule, Prediction::clean), start, options).to_host();
  for (size_t i = 0; i < samples.size(); i++) CHECK(samples[i] == doctest::Approx(i % 2 == 0 ? 1 : -1));
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
  const Level quiet = {std::sqrt(0.9), std::sqrt(0.1)}, even = {std::sqrt(0.5), std::sqrt(0.5)};  // SNR 9 and 1
  CHECK(min_snr_weight(Prediction::noise, 5, quiet) == doctest::Approx(5.0 / 9));
  CHECK(min_snr_weight(Prediction::clean, 5, quiet) == doctest::Approx(5));
  CHECK(min_snr_weight(Prediction::velocity, 5, quiet) == doctest::Approx(0.5));
  CHECK(min_snr_weight(Prediction::noise, 5, even) == doctest::Approx(1));
  CHECK(min_snr_weight(Prediction::clean, 5, even) == doctest::Approx(1));
  CHECK(min_snr_weight(Prediction::velocity, 5, even) == doctest::Approx(0.5));
  const NoiseSchedule schedule;
  const std::vector<int32_t> times = {0, 500, 999};
  const std::vector<float> weights = schedule.min_snr_weights(Prediction::velocity, 5, from_host(times, {3})).to_host();
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
