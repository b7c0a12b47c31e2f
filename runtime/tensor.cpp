// Handles, leaves, and moving values between host and device.
#include "runtime/tensor.h"

#include <cstring>

#include "runtime/cl.h"
#include "runtime/debug.h"
#include "runtime/device_lock.h"
#include "runtime/ops.h"
#include "runtime/ops/pointwise.h"

namespace cloam {

size_t size_of(DType dtype) {
  switch (dtype) {
    case DType::u8:
      return 1;
    case DType::f16:
      return 2;
    case DType::f32:
      return debug().float64 ? 8 : 4;
    default:
      return 4;
  }
}

const char* name_of(DType dtype) {
  static const char* const names[] = {"float32", "int32", "uint32", "uint8", "float16"};
  return names[static_cast<size_t>(dtype)];
}

namespace {

Tensor constant(double value, DType dtype) {
  auto node = std::make_shared<Node>();
  node->op = constant_op();
  node->dtype = dtype;
  node->value = value;
  return Tensor(std::move(node));
}

const Node& of_handle(const std::shared_ptr<Node>& node) {
  if (!node) throw Error(Fault::internal, "[tensor] an empty handle has no shape, no type and no values");
  return *node;
}

}  // namespace

Tensor::Tensor(float value) : Tensor(constant(value, DType::f32)) {}
Tensor::Tensor(double value) : Tensor(constant(value, DType::f32)) {}
Tensor::Tensor(int value) : Tensor(constant(value, DType::i32)) {}

const Shape& Tensor::shape() const { return of_handle(node_).shape; }
int64_t Tensor::dim(int axis) const { return shape()[axis_of("dim", rank(), axis)]; }
DType Tensor::dtype() const { return of_handle(node_).dtype; }
bool Tensor::tracked() const { return of_handle(node_).tracked; }
bool Tensor::evaluated() const {
  const DeviceLock lock;
  return of_handle(node_).storage.buffer != nullptr;
}

/// Long chains of history are freed in a loop: a destructor per link would overflow the stack.
Node::~Node() {
  Tensors pending = std::move(in);
  while (!pending.empty()) {
    Tensor last = std::move(pending.back());
    pending.pop_back();
    if (last && last.ref().use_count() == 1) {
      Tensors more = std::move(last.node()->in);
      for (Tensor& t : more) pending.push_back(std::move(t));
    }
  }
}

bool Storage::dense(const Shape& shape) const {
  if (offset != 0) return false;
  int64_t step = 1;
  for (int i = shape.rank() - 1; i >= 0; i--) {
    if (shape[i] != 1 && strides[i] != step) return false;
    step *= shape[i];
  }
  return true;
}

void Op::run(const Tensors&, Tensor&) const {
  throw Error(Fault::internal, text("[", name(), "] has no kernel to run"));
}

std::optional<Storage> Op::view(const Storage&, const Shape&, const Shape&) const { return std::nullopt; }

namespace {
std::vector<std::string>& op_names() {
  static std::vector<std::string> names;
  return names;
}
}  // namespace
Registered::Registered(const char* name) { op_names().push_back(name); }
const std::vector<std::string>& registered_ops() { return op_names(); }

Tensor make(std::shared_ptr<const Op> op, const Shape& shape, Tensors in, DType dtype) {
  auto node = std::make_shared<Node>();
  node->op = std::move(op);
  node->shape = shape;
  node->dtype = dtype;
  if (dtype == DType::f32 || dtype == DType::f16)
    for (const Tensor& t : in) node->tracked |= t.tracked();
  node->in = std::move(in);
  return Tensor(std::move(node));
}

Tensor empty(const Shape& shape, DType dtype) {
  auto node = std::make_shared<Node>();
  node->shape = shape;
  node->dtype = dtype;
  node->storage = {allocate(static_cast<size_t>(numel(shape)) * size_of(dtype)), 0, dense_strides(shape)};
  return Tensor(std::move(node));
}

Tensor from_bytes(const void* bytes, DType dtype, const Shape& shape) {
  Tensor out = empty(shape, dtype);
  if (dtype == DType::f32 && debug().float64) {
    const auto* const floats = static_cast<const float*>(bytes);
    const std::vector<double> wide(floats, floats + numel(shape));
    write_buffer(*out.node()->storage.buffer, wide.data(), wide.size() * sizeof(double));
    return out;
  }
  write_buffer(*out.node()->storage.buffer, bytes, static_cast<size_t>(numel(shape)) * size_of(dtype));
  return out;
}

namespace {

template <class T>
Tensor from_vector(const std::vector<T>& values, DType dtype, const Shape& shape) {
  if (static_cast<int64_t>(values.size()) != numel(shape))
    throw Error(Fault::internal, text("[from_host] ", values.size(), " values do not fill shape ", to_string(shape)));
  return from_bytes(values.data(), dtype, shape);
}

float half_to_float(uint16_t h) {
  const uint32_t sign = (h & 0x8000u) << 16, exponent = (h >> 10) & 31u, mantissa = h & 1023u;
  if (exponent == 0) {
    const float tiny = static_cast<float>(mantissa) * 0x1p-24f;
    return sign ? -tiny : tiny;
  }
  const uint32_t bits = sign | ((exponent == 31 ? 255u : exponent + 112u) << 23) | (mantissa << 13);
  float out;
  std::memcpy(&out, &bits, 4);
  return out;
}

template <class T>
bool holds(DType dtype) {
  if constexpr (std::is_floating_point_v<T>) return dtype == DType::f32;
  if constexpr (std::is_same_v<T, int32_t>) return dtype == DType::i32;
  if constexpr (std::is_same_v<T, uint32_t>) return dtype == DType::u32;
  return std::is_same_v<T, uint8_t> && dtype == DType::u8;
}

template <class T>
std::vector<T> read_all(const Tensor& packed) {
  std::vector<T> out(static_cast<size_t>(packed.numel()));
  read_buffer(*packed.node()->storage.buffer, 0, out.size() * sizeof(T), out.data());
  return out;
}

}  // namespace

Tensor from_host(const std::vector<float>& values, const Shape& shape) {
  return from_vector(values, DType::f32, shape);
}
Tensor from_host(const std::vector<int32_t>& values, const Shape& shape) {
  return from_vector(values, DType::i32, shape);
}
Tensor from_host(const std::vector<uint32_t>& values, const Shape& shape) {
  return from_vector(values, DType::u32, shape);
}
Tensor from_host(const std::vector<uint8_t>& values, const Shape& shape) {
  return from_vector(values, DType::u8, shape);
}

Tensor parameter(const std::vector<float>& values, const Shape& shape) {
  Tensor out = from_host(values, shape);
  out.node()->tracked = true;
  return out;
}

template <class T>
std::vector<T> Tensor::to_host() const {
  const DeviceLock lock;
  const Tensor packed = dense(*this);
  if constexpr (std::is_same_v<T, float>)
    if (packed.dtype() == DType::f16) {
      std::vector<uint16_t> halves = read_all<uint16_t>(packed);
      return {[&] {
        std::vector<float> out(halves.size());
        for (size_t i = 0; i < out.size(); i++) out[i] = half_to_float(halves[i]);
        return out;
      }()};
    }
  if (!holds<T>(packed.dtype()))
    throw Error(Fault::internal,
                text("[to_host] the tensor holds ", name_of(packed.dtype()), ", another type was asked for"));
  if constexpr (std::is_same_v<T, float>)
    if (debug().float64) {
      const std::vector<double> wide = read_all<double>(packed);
      return {wide.begin(), wide.end()};
    }
  if constexpr (std::is_same_v<T, double>)
    if (!debug().float64) {
      const std::vector<float> narrow = read_all<float>(packed);
      return {narrow.begin(), narrow.end()};
    }
  return read_all<T>(packed);
}
template std::vector<float> Tensor::to_host<float>() const;
template std::vector<double> Tensor::to_host<double>() const;
template std::vector<int32_t> Tensor::to_host<int32_t>() const;
template std::vector<uint32_t> Tensor::to_host<uint32_t>() const;
template std::vector<uint8_t> Tensor::to_host<uint8_t>() const;

void assign(const std::vector<std::pair<Tensor, Tensor>>& updates) {
  const DeviceLock lock;
  Tensors values;
  for (const auto& [target, value] : updates) {
    if (!(target.shape() == value.shape()) || target.dtype() != value.dtype())
      throw Error(Fault::internal,
                  text("[assign] target has shape ", to_string(target.shape()), " ", name_of(target.dtype()),
                       ", value ", to_string(value.shape()), " ", name_of(value.dtype())));
    values.push_back(value);
  }
  eval(values);
  for (const auto& [target, value] : updates) target.node()->storage = dense(value).node()->storage;
}

float Tensor::item() const {
  if (numel() != 1) throw Error(Fault::internal, text("[item] shape ", to_string(shape()), " is not one value"));
  const bool is_float = dtype() == DType::f32 || dtype() == DType::f16;
  return (is_float ? *this : cast(*this, DType::f32)).to_host<float>()[0];
}

}  // namespace cloam
