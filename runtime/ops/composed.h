// Private: derivatives of fused ops by way of their compositions.
#pragma once
#include <functional>

#include "runtime/op.h"

namespace cloam {

/// A fused op written with other ops: the reference it is tested against, and its derivatives beyond the first.
using Composition = std::function<Tensor(const Tensors&)>;

/// What the vjp of composed(in) gives for g = d loss / d composed(in).
Tensors vjp_of(const Composition& composed, const Tensors& in, const Tensor& g);

/// The vjp of an op that gives the gradient in input number `which`; `in`: the inputs of the op that it is the gradient
/// of, and that op's g.
Tensors vjp_of_gradient(const Composition& composed, size_t which, const Tensors& in, const Tensor& g);

/// Tensors end to end in one flat one: the result of a gradient kernel that fills several.
Tensor packed(const Tensors& parts);
/// The parts of a packed tensor, by their shapes.
Tensors unpacked(const Tensor& all, const std::vector<Shape>& shapes);

}  // namespace cloam
