// Op rows that name a benchmark size, forward.
#include <algorithm>

#include "benchmarks/workload.h"
#include "tests/op_cases/op_cases.h"

namespace cloam {
namespace {

/// Inputs read once and a result written once, as large as the largest of them (of a sum: next to nothing); 0 where
/// operations count.
double bytes_of(const OpCase& row) {
  if (row.bench_flops > 0) return 0;
  double sum = 0, largest = 0;
  for (const InputSpec& input : row.bench) {
    const double bytes = 4.0 * static_cast<double>(numel(input.shape));
    sum += bytes;
    largest = std::max(largest, bytes);
  }
  return row.op == "sum" ? sum : sum + largest;
}

}  // namespace

void add_row_workloads(Workloads& all) {
  for (const OpCase& row : op_cases()) {
    if (row.bench.empty()) continue;
    const auto prepare = [&row]() -> Run {
      const Tensors in = make_inputs(row, row.bench);
      eval(in);
      return [&row, in] { eval({row.run(in)}); };
    };
    all.push_back({"op." + row.name(), row.bench_flops, bytes_of(row), prepare, {}});
  }
}

}  // namespace cloam
