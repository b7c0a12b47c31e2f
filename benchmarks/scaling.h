// How cost grows with work: workloads of one family in several sizes.
#pragma once
#include <string>
#include <vector>

#include "benchmarks/bench.h"

namespace cloam {

struct Series {
  std::string name;  // "mlp.4x64.N.fwd"
  std::string unit;  // what N counts
  struct Point {
    double size = 0, ns = 0;  // of one of `size`
  };
  std::vector<Point> points;  // by size
};
/// The fused networks, splats and hash grids among the rows, where there are two sizes at least.
std::vector<Series> series_of(const std::vector<BenchRow>& rows);

/// Nanoseconds a sample over size, both logarithmic, as SVG that follows the reader's light or dark scheme.
std::string plot_of(const std::vector<Series>& all);

}  // namespace cloam
