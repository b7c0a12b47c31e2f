// Schedules, conversions, weights.
#include "models/diffusion/noise_schedule.h"

#include <algorithm>
#include <cmath>

#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr double kCosineOffset = 0.008, kLargestBeta = 0.999;

/// alpha^2 of the cosine schedule, up to a factor; along: 0 at the clean end, 1 at the last time.
double squared_cosine(double along) {
  return std::pow(std::cos((along + kCosineOffset) / (1 + kCosineOffset) * M_PI / 2), 2);
}

double beta_of(Betas betas, int64_t t, int64_t timesteps) {
  const auto now = static_cast<double>(t), count = static_cast<double>(timesteps);
  const double along = timesteps > 1 ? now / (count - 1) : 0;
  switch (betas) {
    case Betas::linear:
      return 1e-4 + (0.02 - 1e-4) * along;
    case Betas::scaled_linear:
      return std::pow(std::sqrt(0.00085) + (std::sqrt(0.012) - std::sqrt(0.00085)) * along, 2);
    case Betas::cosine:
      return std::min(1 - squared_cosine((now + 1) / count) / squared_cosine(now / count), kLargestBeta);
  }
  throw Error(Fault::internal, "[schedule] unknown betas");
}

/// table[t], shaped to stand before [N, ...].
Tensor at(const Tensor& table, const Tensor& t, const Tensor& like) {
  Shape shape = Shape::filled(like.rank(), 1);
  shape[0] = t.dim(0);
  return reshape(gather_rows(table, t), shape);
}

/// x = noisy * x_t + predicted * p.
Conversion to_clean(Prediction from, const Level& l) {
  switch (from) {
    case Prediction::noise:
      return {1 / l.alpha, -l.sigma / l.alpha};
    case Prediction::velocity:
      return {l.alpha, -l.sigma};
    case Prediction::clean:
      break;
  }
  return {};
}

Conversion to_noise(Prediction from, const Level& l) {
  switch (from) {
    case Prediction::clean:
      return {1 / l.sigma, -l.alpha / l.sigma};
    case Prediction::velocity:
      return {l.sigma, l.alpha};
    case Prediction::noise:
      break;
  }
  return {};
}

/// v = alpha e - sigma x, with e or x written with x_t and the other.
Conversion to_velocity(Prediction from, const Level& l) {
  switch (from) {
    case Prediction::clean:
      return {l.alpha / l.sigma, -1 / l.sigma};
    case Prediction::noise:
      return {-l.sigma / l.alpha, 1 / l.alpha};
    case Prediction::velocity:
      break;
  }
  return {};
}

}  // namespace

Betas betas_named(const std::string& name) {
  if (name == "linear") return Betas::linear;
  if (name == "cosine") return Betas::cosine;
  if (name == "scaled-linear") return Betas::scaled_linear;
  throw Error(Fault::usage, text("there is no noise schedule ", name, ": want linear, cosine or scaled-linear"));
}

Conversion conversion(Prediction from, Prediction to, const Level& level) {
  switch (to) {
    case Prediction::clean:
      return to_clean(from, level);
    case Prediction::noise:
      return to_noise(from, level);
    case Prediction::velocity:
      break;
  }
  return to_velocity(from, level);
}

Tensor converted(const Tensor& noisy, const Tensor& predicted, Prediction from, Prediction to, const Level& level) {
  if (from == to) return predicted;
  const Conversion by = conversion(from, to, level);
  return noisy * by.noisy + predicted * by.predicted;
}

NoiseSchedule::NoiseSchedule(Betas betas, int64_t timesteps) {
  if (timesteps < 1) throw Error(Fault::usage, text("a noise schedule of ", timesteps, " timesteps, want 1 or more"));
  double kept = 1;  // alpha^2
  std::vector<float> alpha, sigma;
  for (int64_t t = 0; t < timesteps; t++) {
    kept *= 1 - beta_of(betas, t, timesteps);
    levels_.push_back({std::sqrt(kept), std::sqrt(1 - kept)});
    alpha.push_back(static_cast<float>(levels_.back().alpha));
    sigma.push_back(static_cast<float>(levels_.back().sigma));
  }
  alpha_ = from_host(alpha, {timesteps});
  sigma_ = from_host(sigma, {timesteps});
}

Tensor NoiseSchedule::noisy(const Tensor& x, const Tensor& noise, const Tensor& t) const {
  return at(alpha_, t, x) * x + at(sigma_, t, x) * noise;
}

Tensor NoiseSchedule::clean(const Tensor& noisy, const Tensor& velocity, const Tensor& t) const {
  return at(alpha_, t, noisy) * noisy - at(sigma_, t, noisy) * velocity;
}

Tensor NoiseSchedule::target(Prediction kind, const Tensor& x, const Tensor& noise, const Tensor& t) const {
  if (kind == Prediction::noise) return noise;
  if (kind == Prediction::clean) return x;
  return at(alpha_, t, x) * noise - at(sigma_, t, x) * x;
}

double min_snr_weight(Prediction kind, double gamma, const Level& level) {
  const double ratio = level.alpha * level.alpha / (level.sigma * level.sigma), least = std::min(ratio, gamma);
  if (kind == Prediction::noise) return least / ratio;
  return kind == Prediction::velocity ? least / (ratio + 1) : least;
}

Tensor NoiseSchedule::min_snr_weights(Prediction kind, double gamma, const Tensor& t) const {
  std::vector<float> table;
  for (const Level& level : levels_) table.push_back(static_cast<float>(min_snr_weight(kind, gamma, level)));
  return gather_rows(from_host(table, {timesteps()}), t);
}

}  // namespace cloam
