// Between device tensors and the named tensors of checkpoint files.
#pragma once
#include "models/io/safetensors.h"
#include "runtime/tensor.h"

namespace cloam {

/// The tensors whose names begin with `prefix`, under the rest of their names.
TensorMap with_prefix(const TensorMap& map, const std::string& prefix);
NamedTensor named(const Tensor& tensor);
NamedTensor named_integers(const std::vector<int64_t>& values);
NamedTensor named_floats(const std::vector<float>& values, const std::vector<int64_t>& shape);
NamedTensor named_doubles(const std::vector<double>& values, const std::vector<int64_t>& shape);
/// A leaf with the values stored under `name`. Fault::data naming what is missing or which shape was wanted.
Tensor tensor_from(const TensorMap& map, const std::string& name, const Shape& shape);
std::vector<int64_t> integers_from(const TensorMap& map, const std::string& name, size_t count);
/// As tensor_from, on the host: float, double, int32_t or int64_t.
template <class Value>
std::vector<Value> values_from(const TensorMap& map, const std::string& name, const std::vector<int64_t>& shape);

}  // namespace cloam
