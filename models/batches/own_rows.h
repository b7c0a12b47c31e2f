// What is drawn for a whole batch, and a share of it.
#pragma once
#include "models/io/share.h"
#include "runtime/ops.h"

namespace cloam {

/// The share's rows of what belongs to all rows of a batch, so that it is the same numbers however it is split.
inline Tensor own_rows(const Tensor& all, const Share& share) {
  const int64_t count = all.dim(0);
  return share.ranks == 1 ? all : slice(all, 0, share.begin(count), share.end(count));
}

}  // namespace cloam
