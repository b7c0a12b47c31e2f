// See procedural.h.
#include "models/synth/procedural.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace cloam {

using Eigen::Vector3d;

double lattice_value(int x, int y, int z) {
  const auto key =
      (uint64_t{uint32_t(x)} * 73856093) ^ (uint64_t{uint32_t(y)} * 19349663) ^ (uint64_t{uint32_t(z)} * 83492791);
  return static_cast<double>(mixed(key) >> 11) * 0x1p-53;
}

double noise(const Vector3d& p) {
  const Vector3d cell = p.array().floor();
  const Vector3d t = p - cell;
  const Vector3d s = t.array().square() * (3.0 - 2.0 * t.array());
  double sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    double weight = 1;
    std::array<int, 3> at{};
    for (int i = 0; i < 3; ++i) {
      const int bit = (corner >> i) & 1;
      at[size_t(i)] = int(cell[i]) + bit;
      weight *= bit ? s[i] : 1 - s[i];
    }
    sum += weight * lattice_value(at[0], at[1], at[2]);
  }
  return sum;
}

double stripes(double x, double period, double pulse, double width) {
  // The integral of the pulses from 0 on; Apodaca and Gritz, Advanced RenderMan, 2000, chapter 11.
  const auto covered = [&](double end) {
    const double whole = std::floor(end / period);
    return whole * pulse + std::min(end - whole * period, pulse);
  };
  const double span = std::max(width, 1e-6);
  return (covered(x + 0.5 * span) - covered(x - 0.5 * span)) / span;
}

double inside(double x, double low, double high, double width) {
  const double half = 0.5 * std::max(width, 1e-6);
  return std::max(0.0, std::min(x + half, high) - std::max(x - half, low)) / (2 * half);
}

Vector3d mix(const Vector3d& a, const Vector3d& b, double t) { return a + t * (b - a); }

double srgb(double linear) {
  const double x = std::clamp(linear, 0.0, 1.0);
  return x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
}

}  // namespace cloam
