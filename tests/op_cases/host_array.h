// Arrays of float64 for references: plain indexing, nothing clever.
#pragma once
#include <functional>
#include <vector>

#include "runtime/shape.h"

namespace cloam {

struct HostArray {
  Shape shape;
  std::vector<double> values;

  HostArray() = default;
  explicit HostArray(const Shape& of, double fill = 0) : shape(of), values(static_cast<size_t>(numel(of)), fill) {}
  int64_t size() const { return static_cast<int64_t>(values.size()); }
  int64_t dim(int axis) const { return shape[axis < 0 ? axis + shape.rank() : axis]; }
  size_t place(const Shape& index) const;
  double operator[](int64_t i) const { return values[static_cast<size_t>(i)]; }
  double& operator[](int64_t i) { return values[static_cast<size_t>(i)]; }
  double at(const Shape& index) const { return values[place(index)]; }
  double& at(const Shape& index) { return values[place(index)]; }
  /// The value at the end of `index`, with axes of size 1 spread: NumPy's broadcasting.
  double spread(const Shape& index) const;
};

using HostArrays = std::vector<HostArray>;

/// The nearest number of IEEE 754's binary16, ties to even; inf beyond its range.
double rounded_to_half(double x);
/// Calls `visit` with every index of the shape, in row-major order.
void each_index(const Shape& shape, const std::function<void(const Shape&)>& visit);
/// An array from a formula of the index.
HostArray from_index(const Shape& shape, const std::function<double(const Shape&)>& value);
/// The reference of a pointwise op: operands broadcast, `value` sees one of each.
std::function<HostArray(const HostArrays&)> elementwise(const std::function<double(const double*)>& value);

}  // namespace cloam
