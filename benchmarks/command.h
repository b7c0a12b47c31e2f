// `cloam bench` and `cloam-benchmarks`: one request, one run.
#pragma once
#include "benchmarks/bench.h"

namespace cloam {

struct BenchRequest {
  BenchOptions options;
  bool json = false, quiet = false;
  std::string report;  // a markdown page is written there; the plot beside it
};

/// Progress on stderr, the table or JSON on stdout, the page where asked for. Throws Fault::usage for a pattern that
/// matches nothing (before any device is opened) and Fault::write.
void bench_command(const Workloads& all, const BenchRequest& request);

}  // namespace cloam
