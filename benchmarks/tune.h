// Tuning: which of a kernel's stated variants is fastest on this device, for each size class that a workload meets.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "benchmarks/workload.h"
#include "runtime/variant.h"

namespace cloam {

struct TuneOptions {
  std::string pattern;  // of workload names; empty: all
  int rounds = 5;
};

/// One variant in the place of a choice.
struct Trial {
  const Variant* variant = nullptr;
  double ratio = 1;      // time of the built-in variant over this one's, geometric mean over the workloads
  std::string rejected;  // why it may not win: other bits, a wrong result, no row that checks it; empty: it may
};

struct TuneResult {
  std::string family, size;
  std::vector<std::string> workloads;  // that were timed
  std::vector<Trial> trials;           // the built-in variant first
  size_t winner = 0;
};

/// Times the candidates of every choice that a workload makes and that has more than one, in alternation. Before it
/// may win, a candidate must pass the op rows that make the choice, with the bits of the built-in variant. A winner is
/// faster by 3 % or more. From then on winners serve in this process; keep them with with_tuned(). `before` hears what
/// comes next.
std::vector<TuneResult> tune(const Workloads& workloads, const TuneOptions& options,
                             const std::function<void(const std::string& what, size_t done, size_t all)>& before);

/// Which variants the workloads and op rows of `op` run with on this device and why, one block each. `op` is a part of
/// a workload's name or the name of an op. Empty when there is none such.
std::string explain(const std::string& op, const Workloads& workloads);

}  // namespace cloam
