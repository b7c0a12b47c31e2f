// Parts are sub-buffers of one buffer.
#include "runtime/flat.h"

#include <algorithm>

#include "runtime/cl.h"
#include "runtime/debug.h"
#include "runtime/driver.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

std::shared_ptr<Buffer> part_of(const std::shared_ptr<Buffer>& whole, size_t from, size_t bytes) {
  cl_buffer_region region{from, bytes};
  cl::Buffer mem = called_again_with_room(
      [&] { return text("make a part of ", bytes, " bytes of a buffer"); },
      [&] { return whole->mem.createSubBuffer(CL_MEM_READ_WRITE, CL_BUFFER_CREATE_TYPE_REGION, &region); });
  auto part = std::make_shared<Buffer>(std::move(mem), bytes);
  part->whole = whole;
  return part;
}

bool lies_at(const Tensor& tensor, const Tensor& place) {
  return tensor.node()->storage.buffer == place.node()->storage.buffer;
}

void check_shapes(const Tensor& tensor, const Tensor& place) {
  if (!(tensor.shape() == place.shape()) || tensor.dtype() != place.dtype())
    throw Error(Fault::internal,
                text("[flat] ", to_string(tensor.shape()), " ", name_of(tensor.dtype()), " does not fit a place of ",
                     to_string(place.shape()), " ", name_of(place.dtype())));
}

void check_count(const Tensor& tensor, size_t count) {
  if (tensor.dtype() != DType::f32 || tensor.numel() != static_cast<int64_t>(count))
    throw Error(Fault::internal,
                text("[flat] ", count, " floats do not fit ", to_string(tensor.shape()), " ", name_of(tensor.dtype())));
}

}  // namespace

Tensor made_to_stay(const Tensor& value) {
  auto node = std::make_shared<Node>();
  node->shape = value.shape();
  node->dtype = value.dtype();
  node->tracked = value.tracked();
  const size_t bytes = static_cast<size_t>(value.numel()) * size_of(value.dtype());
  node->storage = {allocate_to_stay(bytes), 0, dense_strides(value.shape())};
  Tensor out(std::move(node));
  put_at(value, out);
  return out;
}

Flat flat_zeros(const std::vector<Shape>& shapes) {
  const cl_uint bits = called([] { return "ask the device how buffers are aligned"; },
                              [] { return cl_device().device.getInfo<CL_DEVICE_MEM_BASE_ADDR_ALIGN>(); });
  const size_t unit = std::max<size_t>(128, bits / 8);
  std::vector<size_t> begins;
  size_t bytes = 0;
  for (const Shape& shape : shapes) {
    begins.push_back(bytes);
    bytes += std::max<size_t>(1, (static_cast<size_t>(numel(shape)) * size_of(DType::f32) + unit - 1) / unit) * unit;
  }
  Flat out;
  out.all = made_to_stay(zeros({static_cast<int64_t>(bytes / size_of(DType::f32))}));
  const std::shared_ptr<Buffer>& whole = out.all.node()->storage.buffer;
  for (size_t i = 0; i < shapes.size(); i++) {
    const size_t end = i + 1 < shapes.size() ? begins[i + 1] : bytes;
    auto node = std::make_shared<Node>();
    node->shape = shapes[i];
    node->storage = {part_of(whole, begins[i], end - begins[i]), 0, dense_strides(shapes[i])};
    out.parts.emplace_back(std::move(node));
  }
  return out;
}

void move_to(const Tensor& tensor, const Tensor& place) {
  put_at(tensor, place);
  tensor.node()->storage = place.node()->storage;
}

void expect_at(const Tensor& value, const Tensor& place) {
  check_shapes(value, place);
  if (!value.evaluated()) value.node()->place = place.node()->storage.buffer;
}

void put_at(const Tensor& value, const Tensor& place) {
  check_shapes(value, place);
  eval({value});
  if (!lies_at(value, place) && value.numel() > 0) pack(value, place);
}

void read_over(const Tensor& tensor, std::span<float> to) {
  check_count(tensor, to.size());
  if (debug().float64) {
    std::ranges::copy(tensor.to_host(), to.begin());
    return;
  }
  const Tensor packed = dense(tensor);
  read_buffer(*packed.node()->storage.buffer, 0, to.size_bytes(), to.data());
}

void write_over(const Tensor& tensor, std::span<const float> values) {
  check_count(tensor, values.size());
  if (debug().float64) return put_at(from_bytes(values.data(), DType::f32, tensor.shape()), tensor);
  write_buffer(*tensor.node()->storage.buffer, values.data(), values.size_bytes());
}

}  // namespace cloam
