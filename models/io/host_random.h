// Random numbers of the host that depend on their key alone, equal on every platform, unlike the standard library's
// distributions: which images a step sees, what made worlds look like. (On the device: Philox, runtime/ops.h.)
#pragma once
#include <cstddef>
#include <cstdint>

namespace cloam {

/// The output function of splitmix64 (Steele, Lea and Flood 2014): one well mixed number for each number.
uint64_t mixed(uint64_t x);

/// splitmix64: a stream for each seed, or for each step of a seed.
class HostRandom {
 public:
  explicit HostRandom(uint64_t seed) : state_(mixed(seed + 1)) {}
  HostRandom(uint64_t seed, uint64_t step) : state_(seed * 0x9e3779b97f4a7c15u + step * 0xd1b54a32d192ed03u) {}
  uint64_t next() { return mixed(state_ += 0x9e3779b97f4a7c15u); }
  size_t below(size_t n) { return static_cast<size_t>(next() % n); }
  float uniform() { return static_cast<float>(next() >> 40) * 0x1p-24f; }  // [0,1)
  double between(double low, double high) { return low + (high - low) * static_cast<double>(next() >> 11) * 0x1p-53; }
  /// One of 0 ... count - 1, by between().
  int one_of(int count) { return static_cast<int>(between(0, count)); }
  bool chance(double probability) { return between(0, 1) < probability; }

 private:
  uint64_t state_;
};

inline uint64_t mixed(uint64_t x) {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

}  // namespace cloam
