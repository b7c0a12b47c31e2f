// A loss that a few wrong returns cannot rule.
#pragma once
#include "runtime/tensor.h"

namespace cloam {

/// The mean of the `kept` least of errors [N], 1 <= kept <= N (UniSim leaves out the worst LiDAR rays of a step); those
/// equal to the largest of them count, too.
Tensor mean_of_least(const Tensor& errors, int64_t kept);
/// The mean without the worst 5 %, at least of the least one.
Tensor mean_without_worst(const Tensor& errors);

}  // namespace cloam
