// Private: where samples lie, and whose values each of them reads, among the inputs of an op.
#pragma once
#include "runtime/tensor.h"

namespace cloam {

/// Inputs [first, end): points [S,axes] and, if there are several owners, the owner of each, int32.
struct Places {
  Places(const Tensors& in, size_t first, size_t end)
      : points(in[first]), owned(end - first > 1), owners(in[end - 1]) {}
  const Tensor& points;
  const bool owned;
  const Tensor& owners;  // where there are none, a buffer for the argument that is not read
};

/// Fault::internal unless there is an int32 owner of each point; an empty handle is none.
void check_owners(const char* op, const Tensor& owners, const Tensor& points);

}  // namespace cloam
