// The tables of a profile.
#include "runtime/profile.h"

#include <algorithm>
#include <cstdio>

#include "cli/common.h"
#include "models/io/commit.h"
#include "runtime/device.h"
#include "runtime/limits.h"

namespace cloam {
namespace {

std::string& trace_file() {
  static std::string path;
  return path;
}

/// What a kernel reached of the limit that it comes nearest to: arithmetic, or the bandwidth for launches of its size.
double share_of_peak(const KernelCost& cost, const DeviceLimits& limits) {
  const double seconds = 1e-3 * cost.ms;
  if (seconds <= 0 || cost.calls == 0) return 0;
  const double compute = cost.flops / seconds * 1e-9 / limits.gflops;
  const double memory = cost.bytes / seconds * 1e-9 / limits.gbps(cost.bytes / static_cast<double>(cost.calls));
  return 100 * std::max(compute, memory);
}

void tell_kernels(const Profile& profile, const DeviceLimits& limits) {
  std::fprintf(stderr, "\n%-32s %9s %11s %7s %9s %8s %7s\n", "kernel", "calls", "total ms", "time", "GFLOP/s", "GB/s",
               "peak");
  for (const KernelCost& cost : profile.kernels) {
    const double ms = std::max(cost.ms, 1e-9);
    std::fprintf(stderr, "%-32s %9lld %11.2f %5.1f %% %9.1f %8.1f %5.0f %%\n", cost.name.c_str(),
                 static_cast<long long>(cost.calls), cost.ms, 0.1 * cost.ms / std::max(profile.device_seconds, 1e-12),
                 cost.flops / ms * 1e-6, cost.bytes / ms * 1e-6, share_of_peak(cost, limits));
  }
}

void tell_work(const Profile& profile, const DeviceLimits& limits) {
  double flops = 0;
  for (const KernelCost& cost : profile.kernels) flops += cost.flops;
  const double gflop = flops * 1e-9, rate = gflop / std::max(profile.device_seconds, 1e-12);
  std::fprintf(stderr, "work      %.1f GFLOP: %.0f GFLOP/s, %.0f %% of the device's peak; peak memory %s\n", gflop,
               rate, 100 * rate / limits.gflops, words_for_bytes(device_stats().peak_bytes).c_str());
}

void tell_step(const StepCost& step) {
  if (step.steps <= 0 || step.ms <= 0) return;
  std::fprintf(stderr, "a step    %.2f ms (mean of %lld): device idle %.1f %%, host waits %.1f %%\n", step.ms,
               static_cast<long long>(step.steps), 100 * std::max(0.0, 1 - step.device_ms / step.ms),
               100 * step.wait_ms / step.ms);
  std::fprintf(stderr, "          %.1f launches, %.1f waits, %.0f bytes allocated\n", step.launches, step.waits,
               step.allocated_bytes);
}

}  // namespace

void begin_profile(const Common& common) {
  if (muted()) return;
  if (!common.profile_trace.empty()) trace_file() = common.profile_trace;
  if (common.profile || !trace_file().empty()) start_profile(!trace_file().empty());
}

void end_profile() {
  if (!profiling()) return;
  const Profile profile = cloam::profile();
  if (!trace_file().empty()) {
    commit_text(trace_file(), trace());
    std::fprintf(stderr, "\ntrace     %s (open it in https://ui.perfetto.dev)\n", trace_file().c_str());
  }
  const DeviceLimits limits = measure_limits();
  tell_kernels(profile, limits);
  std::fprintf(stderr, "limits    %.0f GFLOP/s, memory %.0f GB/s, in place %.0f, last cache %.0f, inner caches %.0f\n",
               limits.gflops, limits.copy_gbps, limits.in_place_gbps, limits.copy_l3_gbps, limits.copy_l2_gbps);
  std::fprintf(stderr, "all       %.2f s: device %.2f s, host waits %.2f s, compiling %.2f s\n", profile.seconds,
               profile.device_seconds, profile.wait_seconds, profile.build_seconds);
  tell_work(profile, limits);
  tell_step(profile.step);
}

}  // namespace cloam
