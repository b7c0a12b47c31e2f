// cloam-benchmarks [PATTERN]: the device's limits, then every workload of the runtime whose name contains PATTERN.
#include <cstdio>

#include "benchmarks/measure.h"
#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/limits.h"

namespace cloam {
namespace {

void report(const Workload& workload, const DeviceLimits& limits) {
  const Sampler sampler(workload.prepare());
  std::vector<double> samples;
  for (int i = 0; i < 9; i++) samples.push_back(sampler.sample());
  const double ms = median(samples), gflops = workload.flops / ms * 1e-6, gbps = workload.bytes / ms * 1e-6;
  std::printf("%-40s %10.3f ms %8.1f GFLOP/s %4.0f %% %8.1f GB/s\n", workload.name.c_str(), ms, gflops,
              100 * gflops / limits.gflops, gbps);
}

void run(const std::string& pattern) {
  const DeviceLimits limits = measure_limits();
  std::printf("%s (%s)\npeak %.0f GFLOP/s fp32, copy %.0f GB/s, launch %.1f us\n", device().name.c_str(),
              device().driver.c_str(), limits.gflops, limits.copy_gbps, limits.launch_us);
  for (const Workload& workload : op_workloads())
    if (workload.name.find(pattern) != std::string::npos) report(workload, limits);
}

}  // namespace
}  // namespace cloam

int main(int count, char** words) {
  try {
    cloam::run(count > 1 ? words[1] : "");
    return 0;
  } catch (const cloam::Error& e) {
    std::fprintf(stderr, "error: %s\n", e.what());
    return static_cast<int>(e.fault());
  }
}
