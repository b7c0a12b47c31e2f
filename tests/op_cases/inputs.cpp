// Values of a row's inputs, on the host and on the device in several layouts.
#include "tests/op_cases/inputs.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cloam {

InputSpec normal(const Shape& shape) { return {.shape = shape}; }
InputSpec between(const Shape& shape, double low, double high) {
  return {.shape = shape, .kind = InputSpec::kUniform, .low = low, .high = high};
}
InputSpec distinct(const Shape& shape) { return {.shape = shape, .kind = InputSpec::kDistinct}; }
InputSpec halves(const Shape& shape) { return {.shape = shape, .dtype = DType::f16}; }
InputSpec below(const Shape& shape, int64_t high, DType dtype) {
  return {.shape = shape,
          .kind = InputSpec::kBelow,
          .low = 0,
          .high = static_cast<double>(high),
          .dtype = dtype,
          .differentiable = false};
}
InputSpec given(const Shape& shape, const std::vector<double>& values, DType dtype) {
  return {
      .shape = shape, .kind = InputSpec::kGiven, .dtype = dtype, .differentiable = is_float(dtype), .given = values};
}
InputSpec constant(InputSpec spec) {
  spec.differentiable = false;
  return spec;
}

Numbers::Numbers(const std::string& seed) : state_(0) {
  for (unsigned char c : seed) state_ = (state_ ^ c) * 0x100000001B3ull + 0x9E3779B9ull;
}

double Numbers::uniform() {
  uint64_t z = (state_ += 0x9E3779B97F4A7C15ull);
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
  return static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

double Numbers::normal() {
  const double radius = std::sqrt(-2 * std::log(1 - uniform()));
  return radius * std::cos(2 * M_PI * uniform());
}

namespace {

void shuffle(std::vector<double>& values, Numbers& numbers) {
  for (size_t i = values.size(); i > 1; i--)
    std::swap(values[i - 1], values[static_cast<size_t>(numbers.below(static_cast<int64_t>(i)))]);
}

double draw(const InputSpec& spec, Numbers& numbers, size_t i) {
  switch (spec.kind) {
    case InputSpec::kUniform:
      return spec.low + (spec.high - spec.low) * numbers.uniform();
    case InputSpec::kDistinct:
      return (static_cast<double>(i) - static_cast<double>(numel(spec.shape)) / 2 + 0.4 * numbers.uniform()) * 0.02;
    case InputSpec::kBelow:
      return static_cast<double>(numbers.below(static_cast<int64_t>(spec.high)));
    case InputSpec::kGiven:
      return spec.given.at(i);
    default:
      return numbers.normal();
  }
}

template <class T>
std::vector<T> converted(const HostArray& values) {
  std::vector<T> out;
  for (double value : values.values) out.push_back(static_cast<T>(value));
  return out;
}

Tensor packed(const HostArray& values, const InputSpec& spec) {
  switch (spec.dtype) {
    case DType::i32:
      return from_host(converted<int32_t>(values), values.shape);
    case DType::u32:
      return from_host(converted<uint32_t>(values), values.shape);
    case DType::u8:
      return from_host(converted<uint8_t>(values), values.shape);
    default:
      const Tensor floats = spec.differentiable ? parameter(converted<float>(values), values.shape)
                                                : from_host(converted<float>(values), values.shape);
      return cast(floats, spec.dtype);
  }
}

/// Axes in reverse: the packed copy whose transposed view is the array.
HostArray reversed(const HostArray& array) {
  Shape shape = array.shape;
  std::reverse(&shape[0], &shape[0] + shape.rank());
  return from_index(shape, [&](const Shape& index) {
    Shape back = index;
    std::reverse(&back[0], &back[0] + back.rank());
    return array.at(back);
  });
}

/// Element i of the last axis at 2 i + 1, and a row more in front of the first axis.
HostArray widened(const HostArray& array, double filler) {
  Shape shape = array.shape;
  const int last = shape.rank() - 1;
  shape[last] = 2 * shape[last] + 1;
  if (last > 0) shape[0]++;
  HostArray out(shape, filler);
  each_index(array.shape, [&](const Shape& index) {
    Shape to = index;
    to[last] = 2 * index[last] + 1;
    if (last > 0) to[0]++;
    out.at(to) = array.at(index);
  });
  return out;
}

Tensor sliced(const HostArray& array, const InputSpec& spec) {
  const double filler = is_float(spec.dtype)       ? std::numeric_limits<double>::quiet_NaN()
                        : spec.dtype == DType::i32 ? -7
                                                   : 250;
  const int last = array.shape.rank() - 1;
  const Tensor wide = packed(widened(array, filler), spec);
  const Tensor rows = last > 0 ? slice(wide, 0, 1, wide.dim(0)) : wide;
  return slice(rows, last, 1, wide.dim(last), 2);
}

}  // namespace

HostArray host_input(const InputSpec& spec, const std::string& seed) {
  Numbers numbers(seed);
  HostArray out(spec.shape);
  for (size_t i = 0; i < out.values.size(); i++) out.values[i] = draw(spec, numbers, i);
  if (spec.kind == InputSpec::kDistinct) shuffle(out.values, numbers);
  if (spec.dtype == DType::f32)
    for (double& value : out.values) value = static_cast<float>(value);
  if (spec.dtype == DType::f16)
    for (double& value : out.values) value = rounded_to_half(value);
  return out;
}

const char* name_of(Lie lie) { return lie == Lie::dense ? "dense" : lie == Lie::transposed ? "transposed" : "sliced"; }

Tensor on_device(const HostArray& values, const InputSpec& spec, Lie lie) {
  if (lie == Lie::dense || values.shape.rank() == 0) return packed(values, spec);
  if (lie == Lie::sliced || values.shape.rank() == 1) return sliced(values, spec);
  Shape axes = values.shape;
  for (int i = 0; i < axes.rank(); i++) axes[i] = axes.rank() - 1 - i;
  return permute(packed(reversed(values), spec), axes);
}

HostArray host_output(const Tensor& tensor) {
  HostArray out(tensor.shape());
  const auto copy = [&](const auto& values) { std::copy(values.begin(), values.end(), out.values.begin()); };
  switch (tensor.dtype()) {
    case DType::i32:
      copy(tensor.to_host<int32_t>());
      break;
    case DType::u32:
      copy(tensor.to_host<uint32_t>());
      break;
    case DType::u8:
      copy(tensor.to_host<uint8_t>());
      break;
    case DType::f16:
      copy(tensor.to_host<float>());
      break;
    case DType::f32:
      copy(tensor.to_host<double>());
  }
  return out;
}

Tensors make_inputs(const OpCase& row, const std::vector<InputSpec>& specs) {
  Tensors out;
  for (size_t i = 0; i < specs.size(); i++)
    out.push_back(on_device(host_input(specs[i], row.name() + std::to_string(i)), specs[i], Lie::dense));
  return out;
}

}  // namespace cloam
