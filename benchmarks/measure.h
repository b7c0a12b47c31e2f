// Timing on the chosen device.
#pragma once
#include <vector>

#include "benchmarks/workload.h"

namespace cloam {

double median(std::vector<double> values);

/// One sample: enough runs back to back to last about 20 ms (`repeats`, found once), then one wait. Milliseconds a run.
class Sampler {
 public:
  explicit Sampler(const Run& run);  // warms up: compiles, fills the pool, finds the number of repeats
  double sample() const;
  int repeats() const { return repeats_; }

 private:
  double seconds(int repeats) const;
  Run run_;
  int repeats_ = 1;
};

}  // namespace cloam
