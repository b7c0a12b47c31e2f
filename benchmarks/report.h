// What a benchmark run found, in three forms.
#pragma once
#include <string>

#include "benchmarks/bench.h"

namespace cloam {

/// An aligned table for a terminal.
std::string table_of(const BenchReport& report);
/// One JSON object (docs/formats.md).
std::string json_of(const BenchReport& report);
/// docs/performance.md: markdown, with the plot at `plot` (a path as the page should name it) where there is one.
std::string page_of(const BenchReport& report, const std::string& plot);

}  // namespace cloam
