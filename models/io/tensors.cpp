// Named tensors.
#include "models/io/tensors.h"

#include <cstring>
#include <type_traits>

#include "runtime/error.h"

namespace cloam {
namespace {

const char* stored_type(DType dtype) {
  constexpr const char* names[] = {"F32", "I32", "U32", "U8", "F16"};  // in the order of DType
  return names[static_cast<size_t>(dtype)];
}

template <class T>
std::vector<std::byte> bytes_of(const std::vector<T>& values) {
  std::vector<std::byte> out(values.size() * sizeof(T));
  std::memcpy(out.data(), values.data(), out.size());
  return out;
}

std::vector<std::byte> host_bytes(const Tensor& tensor) {
  if (tensor.dtype() == DType::i32) return bytes_of(tensor.to_host<int32_t>());
  if (tensor.dtype() == DType::u32) return bytes_of(tensor.to_host<uint32_t>());
  if (tensor.dtype() == DType::u8) return bytes_of(tensor.to_host<uint8_t>());
  if (tensor.dtype() == DType::f32) return bytes_of(tensor.to_host<float>());
  throw Error(Fault::internal, "[checkpoint] float16 tensors are not saved");
}

const NamedTensor& find(const TensorMap& map, const std::string& name) {
  const auto found = map.find(name);
  if (found == map.end()) bad_data("there is no tensor ", name);
  return found->second;
}

}  // namespace

TensorMap with_prefix(const TensorMap& map, const std::string& prefix) {
  TensorMap out;
  for (const auto& [name, tensor] : map)
    if (name.starts_with(prefix)) out[name.substr(prefix.size())] = tensor;
  return out;
}

NamedTensor named(const Tensor& tensor) {
  return {stored_type(tensor.dtype()), {tensor.shape().begin(), tensor.shape().end()}, host_bytes(tensor)};
}

NamedTensor named_integers(const std::vector<int64_t>& values) {
  return {"I64", {static_cast<int64_t>(values.size())}, bytes_of(values)};
}

NamedTensor named_floats(const std::vector<float>& values, const std::vector<int64_t>& shape) {
  return {"F32", shape, bytes_of(values)};
}

NamedTensor named_doubles(const std::vector<double>& values, const std::vector<int64_t>& shape) {
  return {"F64", shape, bytes_of(values)};
}

Tensor tensor_from(const TensorMap& map, const std::string& name, const Shape& shape) {
  const NamedTensor& stored = find(map, name);
  const std::vector<int64_t> want(shape.begin(), shape.end());
  DType dtype = DType::f32;
  for (DType candidate : {DType::i32, DType::u32, DType::u8})
    if (stored.dtype == stored_type(candidate)) dtype = candidate;
  if (stored.shape != want || stored.dtype != stored_type(dtype))
    bad_data("the tensor ", name, " has dtype ", stored.dtype, " and ", stored.data.size(), " bytes, want shape ",
             to_string(shape));
  return from_bytes(stored.data.data(), dtype, shape);
}

template <class Value>
std::vector<Value> values_from(const TensorMap& map, const std::string& name, const std::vector<int64_t>& shape) {
  const NamedTensor& stored = find(map, name);
  const char* dtype = std::is_same_v<Value, float>    ? "F32"
                      : std::is_same_v<Value, double> ? "F64"
                      : sizeof(Value) == 4            ? "I32"
                                                      : "I64";
  if (stored.dtype != dtype || stored.shape != shape) {
    std::string want;
    for (const int64_t extent : shape) want += text(want.empty() ? "" : " x ", extent);
    bad_data("the tensor ", name, " has dtype ", stored.dtype, " and ", stored.data.size(), " bytes, want ", dtype,
             " of shape ", want);
  }
  std::vector<Value> out(stored.data.size() / sizeof(Value));
  std::memcpy(out.data(), stored.data.data(), stored.data.size());
  return out;
}

template std::vector<float> values_from(const TensorMap&, const std::string&, const std::vector<int64_t>&);
template std::vector<double> values_from(const TensorMap&, const std::string&, const std::vector<int64_t>&);
template std::vector<int32_t> values_from(const TensorMap&, const std::string&, const std::vector<int64_t>&);
template std::vector<int64_t> values_from(const TensorMap&, const std::string&, const std::vector<int64_t>&);

std::vector<int64_t> integers_from(const TensorMap& map, const std::string& name, size_t count) {
  return values_from<int64_t>(map, name, {static_cast<int64_t>(count)});
}

}  // namespace cloam
