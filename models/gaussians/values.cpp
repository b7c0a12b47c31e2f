// See values.h.
#include "models/gaussians/values.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::uint64_t kMost = std::uint64_t{1} << 26;
constexpr double kQuarterStep = 0.25 / 255;  // so near to 0 and 1 a byte rounds to them again

bool is_sound(const Gaussians& gaussians, std::size_t g) {
  for (const GaussianArray& field : kGaussianArrays) {
    const float* values = (gaussians.*field.values).data() + g * field.width;
    if (!std::all_of(values, values + field.width, [](float value) { return std::isfinite(value); })) return false;
  }
  const float* scale = &gaussians.scales[3 * g];
  const float* q = &gaussians.rotations[4 * g];
  return std::all_of(scale, scale + 3, [](float value) { return std::isfinite(std::exp(value)); }) &&
         std::any_of(q, q + 4, [](float value) { return value != 0; });
}

}  // namespace

double sigmoid(double logit) { return 1 / (1 + std::exp(-logit)); }

float logit(double opacity, double least) {
  const double inside = std::clamp(opacity, least, 1 - least);
  return static_cast<float>(std::log(inside / (1 - inside)));
}

float log_scale(double deviation) {
  return static_cast<float>(std::log(deviation == 0 ? double(std::numeric_limits<float>::min()) : deviation));
}

std::uint8_t to_byte(double value) { return static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 255.0))); }

float logit_of_byte(std::uint8_t opacity) { return logit(opacity / 255.0, kQuarterStep); }
std::uint8_t byte_of_logit(float opacity) { return to_byte(255 * sigmoid(double(opacity))); }

void check_count(std::uint64_t count, const std::string& file) {
  if (count > kMost) bad_data(file, ": ", count, " Gaussians are declared, the limit is ", kMost);
}

Gaussians zero_gaussians(std::uint64_t count, const std::string& file) {
  check_count(count, file);
  Gaussians gaussians;
  for (const GaussianArray& field : kGaussianArrays) (gaussians.*field.values).resize(count * field.width);
  return gaussians;
}

void append(Gaussians& all, const Gaussians& more) {
  for (const GaussianArray& field : kGaussianArrays) {
    const std::vector<float>& values = more.*field.values;
    (all.*field.values).insert((all.*field.values).end(), values.begin(), values.end());
  }
}

int degree_of(const Gaussians& gaussians) {
  std::size_t used = 0;  // coefficients, of any gaussian
  for (std::size_t i = 0; i < gaussians.sh_rest.size(); ++i) {
    const std::size_t coefficient = i % (3 * kSphericalRest) / 3;
    if (coefficient >= used && std::bit_cast<std::uint32_t>(gaussians.sh_rest[i]) != 0) used = coefficient + 1;
  }
  int degree = 0;
  while (rest_of_degree(degree) < used) ++degree;
  return degree;
}

std::size_t drop_unsound(Gaussians& gaussians) {
  const std::size_t count = gaussians.count();
  std::size_t kept = 0;
  for (std::size_t g = 0; g < count; ++g) {
    if (!is_sound(gaussians, g)) continue;
    if (kept < g) {
      for (const GaussianArray& field : kGaussianArrays) {
        float* values = (gaussians.*field.values).data();
        std::copy_n(values + g * field.width, field.width, values + kept * field.width);
      }
    }
    ++kept;
  }
  for (const GaussianArray& field : kGaussianArrays) (gaussians.*field.values).resize(kept * field.width);
  return count - kept;
}

}  // namespace cloam
