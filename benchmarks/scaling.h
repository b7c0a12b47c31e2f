// How cost grows with work: workloads that differ in one number of their names are points of a series.
#pragma once
#include <string>
#include <vector>

#include "benchmarks/bench.h"

namespace cloam {

struct Series {
  std::string name;  // "mlp.4x64.N.fwd"
  struct Point {
    double size = 0, ns = 0;  // of one of `size`
  };
  std::vector<Point> points;  // by size
};
/// Every series that spans at least two decades of size.
std::vector<Series> series_of(const std::vector<BenchRow>& rows);

/// Nanoseconds a sample over size, both logarithmic, as SVG that follows the reader's light or dark scheme.
std::string plot_of(const std::vector<Series>& all);

}  // namespace cloam
