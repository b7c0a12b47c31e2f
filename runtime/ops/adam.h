// The optimiser's step (ops/adam.cpp): at once, in place, seen through every handle. No graph ops.
#pragma once
#include <optional>

#include "runtime/ops.h"

namespace cloam {

struct AdamStep {
  float learning_rate = 1e-3f, beta1 = 0.9f, beta2 = 0.999f, epsilon = 1e-8f;
  float weight_decay = 0;  // decoupled, as AdamW: the parameter shrinks by learning_rate * weight_decay
  int64_t step = 1;        // from 1
  struct Rows {
    int64_t begin, end;
  };
  std::optional<Rows> rows = {};  // set: all others stay as they are
};
/// parameter, m, v: leaves of one shape, none sharing values with another (m and v begin as zeros(shape)); the gradient
/// has that shape, too. A pending gradient is evaluated: where there are many, eval() all of them together first.
void adam_step(Tensor& parameter, Tensor& m, Tensor& v, const Tensor& gradient, const AdamStep& with);
/// The same for parameter [L, ...] of which few rows are in use: a row whose gradient is all zero stays as it is, each
/// other counts its own steps in row_steps int32 [L] (with.step is not read).
void adam_step_rows(Tensor& parameter, Tensor& m, Tensor& v, Tensor& row_steps, const Tensor& gradient,
                    const AdamStep& with);

}  // namespace cloam
