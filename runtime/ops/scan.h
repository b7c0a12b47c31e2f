// Private: running sums of dense rows, for cumsum, the counters of the radix sort and sizes that the data decide.
#pragma once
#include "runtime/ops.h"

namespace cloam {

/// Fills `out` with the running sums of `in`, both evaluated, dense, [rows, n] and f32 or i32.
void scan_rows(const Tensor& in, const Tensor& out, int64_t rows, const Cumulative& how);

/// One number of an evaluated, dense i32 tensor, such as the sum that says how large a result is. Waits for the device.
int32_t value_at(const Tensor& values, int64_t place);

}  // namespace cloam
