// Arrays of float64 for references.
#include "tests/op_cases/host_array.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace cloam {

size_t HostArray::place(const Shape& index) const {
  int64_t at = 0;
  for (int axis = 0; axis < shape.rank(); axis++) at = at * shape[axis] + index[axis];
  return static_cast<size_t>(at);
}

double HostArray::spread(const Shape& index) const {
  Shape own = shape;
  for (int axis = 0; axis < shape.rank(); axis++)
    own[axis] = shape[axis] == 1 ? 0 : index[index.rank() - shape.rank() + axis];
  return at(own);
}

double rounded_to_half(double x) {
  if (x == 0 || !std::isfinite(x)) return x;
  const double step = std::ldexp(1.0, std::max(std::ilogb(x), -14) - 10), y = std::nearbyint(x / step) * step;
  return std::abs(y) > 65504 ? std::copysign(std::numeric_limits<double>::infinity(), x) : y;
}

void each_index(const Shape& shape, const std::function<void(const Shape&)>& visit) {
  Shape index = Shape::filled(shape.rank(), 0);
  for (int64_t i = 0; i < numel(shape); i++) {
    visit(index);
    for (int axis = shape.rank() - 1; axis >= 0 && ++index[axis] == shape[axis]; axis--) index[axis] = 0;
  }
}

HostArray from_index(const Shape& shape, const std::function<double(const Shape&)>& value) {
  HostArray out(shape);
  size_t next = 0;
  each_index(shape, [&](const Shape& index) { out.values[next++] = value(index); });
  return out;
}

std::function<HostArray(const HostArrays&)> elementwise(const std::function<double(const double*)>& value) {
  return [value](const HostArrays& in) {
    Shape shape = in[0].shape;
    for (const HostArray& x : in) shape = broadcast("reference", shape, x.shape);
    return from_index(shape, [&](const Shape& index) {
      std::array<double, 8> operands{};
      for (size_t i = 0; i < in.size(); i++) operands[i] = in[i].spread(index);
      return value(operands.data());
    });
  };
}

}  // namespace cloam
