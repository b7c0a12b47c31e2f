// Timing on the chosen device.
#include "benchmarks/measure.h"

#include <algorithm>
#include <chrono>

#include "runtime/tensor.h"

namespace cloam {

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0 : values[values.size() / 2];
}

double Sampler::seconds(int repeats) const {
  synchronize();
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < repeats; i++) run_();
  synchronize();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

Sampler::Sampler(const Run& run) : run_(run) {
  double last = seconds(1);
  for (int i = 0; i < 1 || (i < 8 && last * i < 0.2); i++) last = seconds(1);
  constexpr double kLeast = 0.02;
  repeats_ = std::clamp(static_cast<int>(kLeast / std::max(last, 1e-6)) + 1, 1, 1000);
}

double Sampler::sample() const { return 1e3 * seconds(repeats_) / repeats_; }

}  // namespace cloam
