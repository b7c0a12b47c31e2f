// The measured limits of the chosen device, against which kernels are judged.
#pragma once
#include <cstdint>

namespace cloam {

/// Bandwidths count what is read and what is written. The cache sizes are guesses from what the driver tells: a 32nd of
/// the last cache stands for the caches of the cores (or for the same last cache, where there is but one).
struct DeviceLimits {
  double gflops = 0;         // fp32 fused multiply-adds, two operations each
  double copy_gbps = 0;      // arrays far larger than any cache; stores past the caches where that is faster
  double in_place_gbps = 0;  // the same arrays read, changed and written in place
  double copy_l3_gbps = 0;   // arrays that fill half of the last cache
  double copy_l2_gbps = 0;   // arrays that fill a 32nd of it
  double launch_us = 0;      // an empty kernel in a full queue
  double round_trip_us = 0;  // an empty kernel and waiting for it
  /// The bandwidth that a launch over so many bytes can have at most.
  double gbps(double bytes_of_launch) const;
  uint64_t cache_bytes = 0;
};
/// Best of several runs; takes about two seconds. Nothing else should run meanwhile.
DeviceLimits measure_limits();

}  // namespace cloam
