// Measuring peaks.
#include "runtime/limits.h"

#include <algorithm>
#include <chrono>
#include <functional>

#include "runtime/cl.h"

namespace cloam {
namespace {

double best_seconds(const std::function<void()>& work) {
  double best = 1e9;
  for (int i = 0; i < 7; i++) {
    finish();
    const auto start = std::chrono::steady_clock::now();
    work();
    finish();
    best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return best;
}

}  // namespace

DeviceLimits measure_limits() {
  DeviceLimits out;
  cl::Kernel& fma = kernel("limits", "peak_fma");
  const int64_t items = is_cpu_class() ? 8 * int64_t{device().compute_units} : 64 * 1024;
  const int rounds = is_cpu_class() ? 100000 : 2000;
  const Tensor sink = empty({items});
  const Range range = range1(items, is_cpu_class() ? 1 : 64);
  out.gflops = 2.0 * 16 * 24 * rounds * static_cast<double>(items) /
               best_seconds([&] { launch(fma, "peak_fma", range, sink, rounds); }) * 1e-9;

  const int64_t n = int64_t{1} << 26;
  const Tensor from = empty({n}), to = empty({n});
  const int64_t chunk = n / 64;
  const Range copy = is_cpu_class() ? range1(64) : range1(int64_t{1} << 20, 64);
  out.copy_gbps = 8.0 * static_cast<double>(n) /
                  best_seconds([&] { launch(kernel("limits", "peak_copy"), "peak_copy", copy, from, to, n, chunk); }) *
                  1e-9;

  const Tensor one = empty({1});
  out.launch_us = 1e6 / 1000 * best_seconds([&] {
                    for (int i = 0; i < 1000; i++)
                      launch(kernel("limits", "peak_copy"), "peak_copy", range1(1), one, one, 0, 1);
                  });
  return out;
}

}  // namespace cloam
