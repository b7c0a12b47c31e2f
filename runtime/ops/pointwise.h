// A pointwise op is OpenCL C text over the operands a, b, c and its gradient. Rows: ops/pointwise.cpp.
#pragma once
#include <vector>

#include "runtime/op.h"

namespace cloam {

/// What type a row computes in and gives back.
enum class Typing : uint8_t {
  floating,  // operands become float, float result
  same,      // the same, but float16 gives float16
  promote,   // operands become their common type (int with int stays int), result too
  whole,     // the same of integers alone
  mask,      // operands as promote, int32 0/1 result
  cast_to    // result as the node says
};

struct PointwiseOp final : Op {
  using Vjp = Tensors (*)(const Tensors& in, const Tensor& out, const Tensor& g);
  PointwiseOp(const char* id, const char* code, Typing type, Vjp vjp_of)
      : label(id), expression(code), typing(type), grads(vjp_of) {}
  const char* name() const override { return label; }
  OpKind kind() const override { return OpKind::pointwise; }
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override { return grads(in, out, g); }
  const char* label;
  const char* expression;
  Typing typing;
  Vjp grads;
};

std::shared_ptr<const Op> constant_op();

}  // namespace cloam
