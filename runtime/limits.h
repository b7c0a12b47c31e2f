// The measured limits of the chosen device, against which kernels are judged.
#pragma once

namespace cloam {

struct DeviceLimits {
  double gflops = 0;     // fp32 fused multiply-adds, two operations each; best of several runs
  double copy_gbps = 0;  // read + written, arrays far larger than any cache
  double launch_us = 0;  // an empty kernel in a full queue
};
/// Takes about a second. Nothing else should run meanwhile.
DeviceLimits measure_limits();

}  // namespace cloam
