// A Gaussian is known exactly, and so is its best denoiser: what score distillation and guided denoising make of it is
// computed here once more, in double.
#include "models/diffusion/guidance.h"

#include <doctest/doctest.h>

#include <array>
#include <cmath>

#include "models/diffusion/sampler.h"
#include "runtime/ops.h"

using namespace cloam;

namespace {

constexpr std::array<double, 2> kMean = {0.7, -1.2};
constexpr double kDeviation = 0.5;

/// E[x | x_t] of N(mean, deviation^2) is linear in x_t: offset + gain * x_t.
struct Posterior {
  double gain, offset;
};
Posterior posterior(const Level& level, double mean) {
  const double variance = std::pow(level.alpha * kDeviation, 2) + level.sigma * level.sigma;
  const double gain = level.alpha * kDeviation * kDeviation / variance;
  return {gain, mean * (1 - gain * level.alpha)};
}

/// Of rows [N,2], with tensors, so that gradients go through it.
CleanEstimate exact(const NoiseSchedule& schedule) {
  return [&](const Tensor& noisy, const std::vector<int32_t>& times) {
    std::vector<float> gains, offsets;
    for (const int32_t t : times)
      for (const double mean : kMean) {
        const Posterior p = posterior(schedule.level(t), mean);
        gains.push_back(static_cast<float>(p.gain));
        offsets.push_back(static_cast<float>(p.offset));
      }
    return noisy * from_host(gains, noisy.shape()) + from_host(offsets, noisy.shape());
  };
}

double at(const std::vector<float>& values, size_t i) { return static_cast<double>(values[i]); }

}  // namespace

TEST_CASE("score distillation has the gradient sigma^2 (x - x^), through the network as well if that is asked for") {
  const NoiseSchedule schedule;
  const std::vector<int32_t> times = {30, 400, 970};
  const std::vector<float> start = {0.3f, -2, 1.5f, 0.1f, -0.6f, 2.5f}, noise = {1, -0.5f, 0.2f, -1.4f, 0.6f, 0.9f};
  for (const bool through : {false, true}) {
    const Tensor x = parameter(start, {3, 2});
    const Tensor term = distillation(schedule, exact(schedule), x, times, from_host(noise, {3, 2}),
                                     through ? NetworkGradient::included : NetworkGradient::left_out);
    const std::vector<float> got = grad(term, {x}).front().to_host();
    double want_term = 0;
    for (size_t i = 0; i < start.size(); ++i) {
      CAPTURE(i);
      const Level level = schedule.level(times[i / 2]);
      const Posterior p = posterior(level, kMean[i % 2]);
      const double noisy = level.alpha * at(start, i) + level.sigma * at(noise, i);
      const double error = at(start, i) - (p.offset + p.gain * noisy), weight = level.sigma * level.sigma;
      const double slope = through ? 1 - p.gain * level.alpha : 1;
      CHECK(at(got, i) == doctest::Approx(weight * error * slope).epsilon(1e-4));
      want_term += 0.5 * weight * error * error;
    }
    CHECK(static_cast<double>(term.item()) == doctest::Approx(want_term).epsilon(1e-4));
  }
}

TEST_CASE("score distillation alone pulls to the mean") {
  const NoiseSchedule schedule;
  std::vector<float> now = {4, 4, -4, 0};
  for (uint32_t step = 0; step < 300; ++step) {
    const Tensor x = parameter(now, {2, 2});
    const std::vector<int32_t> times = {static_cast<int32_t>(20 + 37 * step % 960),
                                        static_cast<int32_t>(20 + 53 * step % 960)};
    const Tensor term = distillation(schedule, exact(schedule), x, times, random_normal({2, 2}, {1, step}));
    now = (x - grad(term, {x}).front() * 0.05f).to_host();
  }
  for (size_t i = 0; i < now.size(); ++i) CHECK(std::abs(at(now, i) - kMean[i % 2]) < 0.2);
}

TEST_CASE("guidance moves each row by its strength, but hardly one that it hardly reaches, and none without it") {
  const Tensor clean = from_host(std::vector<float>{1, 2, 3, 4, 5, 6, 7, 8}, {4, 2});
  const Level level = {0.6, 0.8};
  const std::vector<float> by = {3e-6f, -4e-6f, 0, 0, 0, 1e-6f, 5e-8f, 0};
  const std::vector<float> got = guided_clean(clean, from_host(by, {4, 2}), level, 0.5f).to_host();
  const double far = 0.5 * 0.8 * std::sqrt(2);  // the length of a move of root mean square 0.5 sigma
  CHECK(at(got, 0) == doctest::Approx(1 - far * 0.6));
  CHECK(at(got, 1) == doctest::Approx(2 + far * 0.8));
  CHECK(got[2] == 3);
  CHECK(got[3] == 4);
  CHECK(got[4] == 5);
  CHECK(at(got, 5) == doctest::Approx(6 - far));
  CHECK(at(got, 6) == doctest::Approx(7 - far * 0.1));  // a hundredth of the first row's: a tenth of a tenth
  CHECK(got[7] == 8);
  CHECK(guided_clean(clean, zeros({4, 2}), level, 0.5f).to_host() == clean.to_host());
}

TEST_CASE("denoising that a measurement guides ends nearer to the truth than without, and as the prior has the rest") {
  const NoiseSchedule schedule;
  constexpr int64_t kRows = 64;
  const std::array<float, 2> truth = {1.4f, -1.2f};  // more than a deviation from the mean; the second is not measured
  const auto mean_error = [&](float strength) {
    const Denoiser denoiser = [&](const Tensor& noisy, int64_t t) {
      const std::vector<int32_t> times(static_cast<size_t>(kRows), static_cast<int32_t>(t));
      const Tensor clean = exact(schedule)(noisy, times);
      const Tensor seen = parameter(clean.to_host(), clean.shape());
      const Tensor loss = sum(square(slice(seen, 1, 0, 1) - truth[0]));
      return guided_clean(clean, grad(loss, {seen}).front(), schedule.level(t), strength);
    };
    SamplerOptions options;
    options.steps = 50;
    const std::vector<float> samples =
        sample(schedule, Prediction::clean, denoiser, random_normal({kRows, 2}, {5}), options).to_host();
    std::array<double, 2> error = {0, 0};
    for (size_t i = 0; i < samples.size(); ++i)
      error[i % 2] += std::abs(at(samples, i) - static_cast<double>(truth[i % 2])) / static_cast<double>(kRows);
    return error;
  };
  const auto free = mean_error(0), guided = mean_error(0.5f);
  CHECK(free[0] > 0.5);
  CHECK(guided[0] < 0.6 * free[0]);
  CHECK(guided[1] == doctest::Approx(free[1]).epsilon(1e-3));
}
