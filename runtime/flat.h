// Tensors that lie one behind the other in one buffer, so that one launch can serve them all.
#pragma once
#include <span>

#include "runtime/tensor.h"

namespace cloam {

/// `all` [n] f32 and the parts are the same memory: a change to one is seen through the other. The gaps between parts
/// (each begins where the device allows a buffer to begin) hold zeros at first.
struct Flat {
  Tensor all;
  Tensors parts;
};
Flat flat_zeros(const std::vector<Shape>& shapes);

/// Gives `tensor` the memory of `place` (of its shape), with the values it has; nothing when it lies there already.
void move_to(const Tensor& tensor, const Tensor& place);
/// A hint: a pending value, when it is evaluated, shall be written straight into the memory of `place`. Then it is
/// overwritten when another value is put there.
void expect_at(const Tensor& value, const Tensor& place);
/// Evaluates `value` and copies it into the memory of `place`, unless the hint put it there.
void put_at(const Tensor& value, const Tensor& place);

struct Read {
  Tensor from;
  std::span<float> to;
};
/// Evaluates f32 tensors and copies their values, row-major, over host memory of their sizes.
void read_over(const std::vector<Read>& reads);
struct Write {
  Tensor to;
  std::span<const float> from;
};
/// Copies values into the memory of evaluated f32 tensors of their numbers, which are dense.
void write_over(const std::vector<Write>& writes);

}  // namespace cloam
