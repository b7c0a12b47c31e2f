// Private: what scatter_add_rows shares with the segment ops.
#pragma once
#include "runtime/tensor.h"

namespace cloam {

/// Fills out [L, ...] with the sums of values[order[k]] (or, with an empty order, values[k]) for k in [offsets[l],
/// offsets[l+1]), in that order. All evaluated and dense.
void sum_segments(const Tensor& values, const Tensor& order, const Tensor& offsets, const Tensor& out);

}  // namespace cloam
