// Bias, residual and activation of a finished sum: flags for kernels, composition, gradient.
#include "runtime/ops/epilogue.h"

#include <algorithm>

namespace cloam {

int epilogue_flags(const Epilogue& with) {
  return (with.bias ? kBias : 0) | (with.residual ? kResidual : 0) | (with.activation == Activation::relu ? kRelu : 0) |
         (with.activation == Activation::silu ? kSilu : 0);
}

Tensor composed_epilogue(const Tensor& sums, const Tensor& bias, const Epilogue& with) {
  Tensor y = sums;
  if (bias) y = y + bias;
  if (with.residual) y = y + with.residual;
  if (with.activation == Activation::relu) return relu(y);
  return with.activation == Activation::silu ? silu(y) : y;
}

bool fuses(const Tensors& inputs, const Epilogue& with) {
  if (with.activation != Activation::silu) return true;
  return std::none_of(inputs.begin(), inputs.end(), [](const Tensor& t) { return t && t.tracked(); });
}

Tensor before_epilogue(int flags, const Tensor& result, const Tensor& g) {
  return flags & kRelu ? where(result > 0.f, g, 0.f) : g;
}

}  // namespace cloam
