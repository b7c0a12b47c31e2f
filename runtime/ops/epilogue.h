// Private: what the ops that end in an Epilogue (linear, conv2d) share. Their nodes take the sum's own inputs first,
// then the bias if there is one, then the residual if there is one.
#pragma once
#include "runtime/ops.h"

namespace cloam {

/// As kernels/prelude.cl spells them.
enum EpilogueFlag { kBias = 1, kResidual = 2, kRelu = 4, kSilu = 8 };
int epilogue_flags(const Epilogue& with);

/// The composition. `bias` in a shape that broadcasts over the sums, or empty.
Tensor composed_epilogue(const Tensor& sums, const Tensor& bias, const Epilogue& with);

/// Whether the fused op has a cheap gradient: relu's is told from the result, that of silu needs the sums.
bool fuses(const Tensors& inputs, const Epilogue& with);
/// d loss / d sums from d loss / d result, for what fuses().
Tensor before_epilogue(int flags, const Tensor& result, const Tensor& g);

}  // namespace cloam
