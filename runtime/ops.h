// Every op: signature, meaning, shapes. Letters: N batch, C channels, H W, K out channels, R rays, S samples, L rows.
// Operands of pointwise ops broadcast as in NumPy. Shape errors name the op, the shapes and what was wanted.
#pragma once
#include "runtime/tensor.h"

namespace cloam {

// ---- Pointwise (ops/pointwise.cpp). Integer operands stay integers where C would keep them; comparisons give int32 0/1.
Tensor operator+(const Tensor& a, const Tensor& b);
Tensor operator-(const Tensor& a, const Tensor& b);
Tensor operator*(const Tensor& a, const Tensor& b);
Tensor operator/(const Tensor& a, const Tensor& b);
Tensor operator-(const Tensor& x);
Tensor operator<(const Tensor& a, const Tensor& b);
Tensor operator>(const Tensor& a, const Tensor& b);
Tensor operator<=(const Tensor& a, const Tensor& b);
Tensor equal(const Tensor& a, const Tensor& b);
Tensor minimum(const Tensor& a, const Tensor& b);  // at ties the gradient goes to b
Tensor maximum(const Tensor& a, const Tensor& b);  // at ties the gradient goes to b
Tensor pow(const Tensor& a, const Tensor& b);      // a >= 0
Tensor atan2(const Tensor& a, const Tensor& b);
Tensor modulo(const Tensor& a, const Tensor& b);  // integers, C's remainder
Tensor abs(const Tensor& x);
Tensor sign(const Tensor& x);   // no gradient
Tensor floor(const Tensor& x);  // no gradient
Tensor square(const Tensor& x);
Tensor sqrt(const Tensor& x);
Tensor rsqrt(const Tensor& x);
Tensor exp(const Tensor& x);
Tensor log(const Tensor& x);
Tensor sin(const Tensor& x);  // |x| < 8192
Tensor cos(const Tensor& x);
Tensor tanh(const Tensor& x);
Tensor erf(const Tensor& x);
Tensor sigmoid(const Tensor& x);
Tensor softplus(const Tensor& x);
Tensor silu(const Tensor& x);
Tensor relu(const Tensor& x);
Tensor leaky_relu(const Tensor& x, float slope);
Tensor gelu(const Tensor& x);  // x * Phi(x)
Tensor clamp(const Tensor& x, const Tensor& low, const Tensor& high);
Tensor where(const Tensor& condition, const Tensor& yes, const Tensor& no);  // condition: an integer mask
Tensor cast(const Tensor& x, DType dtype);                                   // float to integer truncates
Tensor stop_gradient(const Tensor& x);

// ---- Views (ops/view.cpp): no copy where strides allow.
Tensor reshape(const Tensor& x, const Shape& shape);  // one extent may be -1
Tensor permute(const Tensor& x, const Shape& axes);
Tensor transpose(const Tensor& x, int axis_a = -1, int axis_b = -2);
Tensor slice(const Tensor& x, int axis, int64_t begin, int64_t end, int64_t step = 1);
Tensor broadcast_to(const Tensor& x, const Shape& shape);
Tensor unsqueeze(const Tensor& x, int axis);  // a new axis of size 1 before `axis` (-1: last)
Tensor bitcast(const Tensor& x, DType dtype);  // same bytes, dtype of equal size

// ---- New leaves.
Tensor full(const Shape& shape, float value);
Tensor zeros(const Shape& shape);
Tensor ones(const Shape& shape);

// ---- Reductions (ops/reduce.cpp): over `axes` (empty: all). One fixed order of summation a device class.
struct Reduce {
  std::vector<int> axes = {};
  bool keep = false;  // keep reduced axes with size 1
};
Tensor sum(const Tensor& x, const Reduce& over = {});
Tensor mean(const Tensor& x, const Reduce& over = {});
Tensor max(const Tensor& x, const Reduce& over = {});  // the gradient is shared among ties
Tensor min(const Tensor& x, const Reduce& over = {});
Tensor sum_to(const Tensor& x, const Shape& shape);  // transpose of broadcast_to

// ---- Joining (ops/join.cpp).
Tensor concat(const Tensors& parts, int axis);
Tensors split(const Tensor& x, int axis, const std::vector<int64_t>& sizes);
Tensor pad(const Tensor& x, int axis, int64_t before, int64_t after);  // zeros

}  // namespace cloam
