// Parts of long random tensors.
#pragma once
#include "runtime/ops.h"

namespace cloam {

/// random_normal of a longer tensor, from the block of four numbers `first_block` on.
Tensor random_normal(const Shape& shape, const RandomKey& key, uint64_t first_block);

}  // namespace cloam
