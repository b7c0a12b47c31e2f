// Where a step's gradients and parameters lie.
#pragma once
#include <optional>

#include "models/train/ranks.h"
#include "runtime/flat.h"

namespace cloam {

/// Parts of the same shapes. Ranks of one host whose devices compute in its memory have the parameters in common and
/// see each other's gradients.
struct StepMemory {
  Flat parameters, gradients;
  std::vector<std::span<const float>> rows_of_ranks;  // this rank's rows of each rank's gradients; none: not in common
};

/// What ranks share out, of all parts together: so many rows of so many floats.
struct SharedRows {
  int64_t count = 0, width = 1;
};
/// In common, where that can be. Every rank calls it.
std::optional<StepMemory> memory_in_common(const Ranks& ranks, const std::vector<Shape>& shapes,
                                           const SharedRows& rows);

}  // namespace cloam
