// The reduce op as the plan sees it: its kind and which axes go.
#pragma once
#include "runtime/op.h"

namespace cloam {

enum class Reduction : uint8_t { sum, max, min };

/// The result keeps reduced axes with size 1; dropping them is a reshape on top.
struct ReduceOp final : Op {
  ReduceOp(Reduction which, uint32_t reduced) : reduction(which), axes(reduced) {}
  const char* name() const override;
  OpKind kind() const override { return OpKind::reduce; }
  uint64_t key() const override { return axes; }
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override;
  Reduction reduction;
  uint32_t axes;  // bit i: axis i is reduced
};

}  // namespace cloam
