// A benchmark run: the device's limits, then workloads, each taking turns with its peers.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "benchmarks/workload.h"
#include "runtime/limits.h"

namespace cloam {

struct BenchOptions {
  std::vector<std::string> patterns;  // parts of names; none: all
  bool peers = false;
  int rounds = 0;             // 0: nine, or five where a round takes longer than a second
  double budget_seconds = 0;  // after which no workload begins, from the start of run_bench; 0: none
};

/// One way of one peer to do a workload's work.
struct PeerTime {
  std::string name;  // "torch", "torch@channels_last"
  double ms = 0;     // median
};

struct BenchRow {
  std::string name, variant;  // the kernels that were chosen, as their files state them
  double ms = 0;              // median of one run
  double flops = 0, bytes = 0;
  double host_share = 0, launches = 0, bytes_allocated = 0;  // of a run
  std::vector<PeerTime> peers;                               // fastest first
  double gflops() const { return flops / ms * 1e-6; }
  double gbps() const { return bytes / ms * 1e-6; }
  double ratio() const { return peers.empty() ? 0 : peers.front().ms / ms; }
  /// Of the measured peak for a row with operations, else of the measured copy bandwidth; 0 for one with neither.
  double share(const DeviceLimits& limits) const;
};

struct BenchReport {
  DeviceLimits limits;
  std::vector<BenchRow> rows;
  struct PeerLibrary {
    std::string name, library;             // "torch", "libtorch 1.13.1"
    std::vector<std::string> environment;  // set beside our own
  };
  std::vector<PeerLibrary> peers;  // those that took part
  std::vector<std::string> notes;  // peers that are missing or failed, workloads that could not run
};

/// Those whose name contains one of the patterns. Throws Fault::usage, naming the nearest, if one matches nothing.
Workloads chosen_workloads(const Workloads& all, const std::vector<std::string>& patterns);

/// `tell` hears which workload comes next. A peer or workload that fails is noted; the others go on.
BenchReport run_bench(const Workloads& workloads, const BenchOptions& options,
                      const std::function<void(const std::string&)>& tell);

}  // namespace cloam
