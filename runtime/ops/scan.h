// Private: running sums of dense rows, for cumsum and for the counters of the radix sort.
#pragma once
#include "runtime/ops.h"

namespace cloam {

/// Fills `out` with the running sums of `in`, both evaluated, dense, [rows, n] and f32 or i32.
void scan_rows(const Tensor& in, const Tensor& out, int64_t rows, const Cumulative& how);

}  // namespace cloam
