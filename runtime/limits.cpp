// Short loops over kernels/limits.cl; the best of several runs is the limit.
#include "runtime/limits.h"

#include <algorithm>
#include <chrono>
#include <functional>

#include "runtime/ops/share.h"

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

double gbps_of(double bytes, const std::function<void()>& work) { return bytes / best_seconds(work) * 1e-9; }

double peak_gflops() {
  const bool cpu = is_cpu_class();
  const int64_t items = cpu ? 8 * int64_t{device().compute_units} : 128 * 1024;
  const int rounds = cpu ? 100000 : 6000;
  const double operations = 2.0 * 16 * (cpu ? 24 : 1) * rounds * static_cast<double>(items);
  const char* const name = cpu ? "peak_fma" : "peak_fma_lanes";
  const Tensor sink = empty({items});
  const Range range = range1(items, cpu ? 1 : 64);
  return operations * 1e-9 / best_seconds([&] { launch(kernel("limits", name), name, range, sink, rounds); });
}

/// Fresh pages that were never written are all one page of zeros: reading them would cost nothing.
Tensor written(int64_t n) {
  const Tensor out = empty({n});
  const WorkShare work = share(n, 1);
  launch(kernel("limits", "peak_in_place"), "peak_in_place", work.range, out, n, work.chunk);
  return out;
}

/// `bytes` of two arrays together, copied as often as makes a launch long.
double cached_gbps(uint64_t bytes) {
  const auto n = static_cast<int64_t>(bytes / 8);
  const int rounds = static_cast<int>(std::max<int64_t>(1, (int64_t{1} << 26) / n));
  const Tensor from = written(n), to = written(n);
  const int64_t each = (n + device().compute_units - 1) / device().compute_units;  // a core keeps its part
  const WorkShare work = is_cpu_class() ? WorkShare{each, range1((n + each - 1) / each)} : share(n, 1);
  return gbps_of(8.0 * static_cast<double>(n) * rounds, [&] {
    launch(kernel("limits", "peak_copy"), "peak_copy", work.range, from, to, n, work.chunk, rounds);
  });
}

void measure_memory(DeviceLimits& out) {
  const int64_t n = int64_t{1} << 26;
  const Tensor from = written(n), to = written(n);
  const WorkShare work = share(n, 1), vectors = share(n / 16, 1);
  const double bytes = 8.0 * static_cast<double>(n);
  const double plain = gbps_of(
      bytes, [&] { launch(kernel("limits", "peak_copy"), "peak_copy", work.range, from, to, n, work.chunk, 1); });
  const double streamed = gbps_of(bytes, [&] {
    launch(kernel("limits", "peak_stream"), "peak_stream", vectors.range, from, to, n / 16, vectors.chunk);
  });
  out.copy_gbps = std::max(plain, streamed);
  out.in_place_gbps = gbps_of(
      bytes, [&] { launch(kernel("limits", "peak_in_place"), "peak_in_place", work.range, to, n, work.chunk); });
}

}  // namespace

double DeviceLimits::gbps(double bytes_of_launch) const {
  const auto cache = static_cast<double>(cache_bytes);
  if (bytes_of_launch <= cache / 32) return std::max({copy_l2_gbps, copy_l3_gbps, copy_gbps});
  if (bytes_of_launch <= cache) return std::max(copy_l3_gbps, copy_gbps);
  return std::max(copy_gbps, in_place_gbps);
}

DeviceLimits measure_limits() {
  constexpr uint64_t kGuess = 32 << 20;  // where the driver tells no cache
  DeviceLimits out;
  out.cache_bytes = device().cache_bytes ? device().cache_bytes : kGuess;
  out.gflops = peak_gflops();
  measure_memory(out);
  out.copy_l3_gbps = cached_gbps(out.cache_bytes / 2);
  out.copy_l2_gbps = cached_gbps(out.cache_bytes / 32);
  const Tensor one = empty({1});
  const auto empty_kernel = [&] { launch(kernel("limits", "peak_in_place"), "empty", range1(1), one, 0, 1); };
  out.launch_us = 1e6 / 1000 * best_seconds([&] {
                    for (int i = 0; i < 1000; i++) empty_kernel();
                  });
  out.round_trip_us = 1e6 * best_seconds(empty_kernel);
  out.gflops = std::max(out.gflops, peak_gflops());  // a second look: something else may have held a core at first
  return out;
}

}  // namespace cloam
