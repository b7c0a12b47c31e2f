// Random choices, smooth noise and colours for things that are made by rule: equal on every platform, unlike the
// standard library's distributions.
#pragma once
#include <Eigen/Core>
#include <cstdint>

namespace cloam {

/// splitmix64 (Steele, Lea and Flood 2014): one well mixed number for each number.
uint64_t mixed(uint64_t x);

/// A stream of random numbers for each seed.
class Random {
 public:
  explicit Random(uint64_t seed) : state_(mixed(seed + 1)) {}
  uint64_t bits();
  double between(double low, double high);
  /// One of 0 ... count - 1.
  int below(int count) { return static_cast<int>(between(0, count)); }
  bool chance(double probability) { return between(0, 1) < probability; }

 private:
  uint64_t state_;
};

/// A value in [0,1) for each place of the whole numbers.
double lattice_value(int x, int y, int z);
/// Smooth noise in [0,1] with features of about one unit.
double noise(const Eigen::Vector3d& p);

/// What part of [x - width / 2, x + width / 2] lies in the pulses [k period, k period + pulse), k whole: a pattern of
/// stripes that turns into its mean where a pixel covers many of them.
double stripes(double x, double period, double pulse, double width);

/// What part of [x - width / 2, x + width / 2] lies in [low, high].
double inside(double x, double low, double high, double width);

Eigen::Vector3d mix(const Eigen::Vector3d& a, const Eigen::Vector3d& b, double t);

/// Linear brightness to the sRGB curve; clamped to [0,1].
double srgb(double linear);

}  // namespace cloam
