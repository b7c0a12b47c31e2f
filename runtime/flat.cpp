// Parts are sub-buffers of one buffer.
#include "runtime/flat.h"

#include <algorithm>

#include "runtime/cl.h"
#include "runtime/debug.h"
#include "runtime/device_lock.h"
#include "runtime/driver.h"
#include "runtime/ops.h"
#include "runtime/ops/share.h"

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

void use_rows(const Tensor& tensor, int64_t begin, int64_t end, HostUse kind,
              const std::function<void(std::span<std::byte>)>& use) {
  const DeviceLock lock;
  const Storage& storage = tensor.node()->storage;
  if (!storage.buffer || !storage.dense(tensor.shape()) || tensor.rank() == 0 || begin < 0 || begin > end ||
      end > tensor.dim(0))
    throw Error(Fault::internal, text("[flat] rows ", begin, " to ", end, " of ", to_string(tensor.shape()),
                                      ": want rows of an evaluated and dense tensor"));
  const size_t row = static_cast<size_t>(row_width(tensor.shape())) * size_of(tensor.dtype());
  use_on_host(*storage.buffer, static_cast<size_t>(begin) * row, static_cast<size_t>(end - begin) * row, kind, use);
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

namespace {

/// Where parts of these shapes begin, in floats, and where the last one ends.
std::vector<int64_t> begins_of(const std::vector<Shape>& shapes) {
  const DeviceLock lock;
  const cl_uint bits = called([] { return "ask the device how buffers are aligned"; },
                              [] { return cl_device().device.getInfo<CL_DEVICE_MEM_BASE_ADDR_ALIGN>(); });
  const auto unit = static_cast<int64_t>(std::max<size_t>(128, bits / 8) / size_of(DType::f32));
  std::vector<int64_t> begins = {0};
  for (const Shape& shape : shapes)
    begins.push_back(begins.back() + std::max<int64_t>(1, (numel(shape) + unit - 1) / unit) * unit);
  return begins;
}

Tensor part_of(const Flat& flat, size_t begin, size_t end, const Shape& shape) {
  const auto byte_of = [&](size_t part) { return static_cast<size_t>(flat.begins[part]) * size_of(DType::f32); };
  auto node = std::make_shared<Node>();
  node->shape = shape;
  node->storage = {part_of(flat.all.node()->storage.buffer, byte_of(begin), byte_of(end) - byte_of(begin)), 0,
                   dense_strides(shape)};
  return Tensor(std::move(node));
}

void make_parts(Flat& flat, const std::vector<Shape>& shapes) {
  for (size_t i = 0; i < shapes.size(); i++) flat.parts.push_back(part_of(flat, i, i + 1, shapes[i]));
}

}  // namespace

Flat flat_zeros(const std::vector<Shape>& shapes) {
  const DeviceLock lock;
  Flat out;
  out.begins = begins_of(shapes);
  out.all = made_to_stay(zeros({out.begins.back()}));
  make_parts(out, shapes);
  return out;
}

Flat flat_in(std::shared_ptr<std::byte> memory, const std::vector<Shape>& shapes) {
  const DeviceLock lock;
  Flat out;
  out.begins = begins_of(shapes);
  auto node = std::make_shared<Node>();
  node->shape = {out.begins.back()};
  const size_t bytes = static_cast<size_t>(out.begins.back()) * size_of(DType::f32);
  node->storage = {buffer_in(std::move(memory), bytes), 0, dense_strides(node->shape)};
  out.all = Tensor(std::move(node));
  make_parts(out, shapes);
  return out;
}

bool computes_in_host_memory() {
  const DeviceLock lock;
  if (!device().is_cpu || debug().bounds || debug().poison || debug().float64) return false;
  constexpr int64_t kCount = 1024;
  constexpr std::align_val_t kPage{4096};
  const std::shared_ptr<std::byte> memory(static_cast<std::byte*>(::operator new(kCount * sizeof(float), kPage)),
                                          [](std::byte* at) { ::operator delete(at, kPage); });
  auto* const values = reinterpret_cast<float*>(memory.get());
  std::fill_n(values, kCount, 1.f);
  const Flat flat = flat_in(memory, {{kCount}});
  std::fill_n(values, kCount, 2.f);  // behind the driver's back
  if (sum(flat.all).item() != 2.f * kCount) return false;
  put_at(full({kCount}, 3.f), flat.parts[0]);
  synchronize();
  return std::all_of(values, values + kCount, [](float value) { return value == 3.f; });
}

int64_t flat_size(const std::vector<Shape>& shapes) { return begins_of(shapes).back(); }

Tensor joined(const Flat& flat, size_t begin, size_t end) {
  const DeviceLock lock;
  return part_of(flat, begin, end, {flat.begins[end] - flat.begins[begin]});
}

void move_to(const Tensor& tensor, const Tensor& place) {
  const DeviceLock lock;
  put_at(tensor, place);
  tensor.node()->storage = place.node()->storage;
}

void expect_at(const Tensor& value, const Tensor& place) {
  check_shapes(value, place);
  const DeviceLock lock;
  if (!value.evaluated()) value.node()->place = place.node()->storage.buffer;
}

void put_at(const Tensor& value, const Tensor& place) {
  check_shapes(value, place);
  const DeviceLock lock;
  eval({value});
  if (!lies_at(value, place) && value.numel() > 0) pack(value, place);
}

void read_on_host(const Tensor& tensor, const std::function<void(std::span<const float>)>& use) {
  if (tensor.dtype() != DType::f32)
    throw Error(Fault::internal, text("[flat] floats are to be read of a tensor of ", name_of(tensor.dtype())));
  if (debug().float64) return use(tensor.to_host());
  const DeviceLock lock;
  const Tensor packed = dense(tensor);
  const size_t count = static_cast<size_t>(packed.numel());
  use_on_host(*packed.node()->storage.buffer, 0, count * sizeof(float), HostUse::read, [&](std::span<std::byte> bytes) {
    use({reinterpret_cast<const float*>(bytes.data()), count});
  });
}

std::shared_ptr<const std::byte> host_view(const Tensor& tensor) {
  const DeviceLock lock;
  const bool is_parameter = tensor.tracked() && !tensor.node()->op;
  if (is_parameter || tensor.numel() == 0 || !device().shares_host_memory || debug().float64) return nullptr;
  const Tensor packed = dense(tensor);
  const std::shared_ptr<Buffer>& buffer = packed.node()->storage.buffer;
  if (buffer->whole || !buffer->pooled) return nullptr;
  return mapped_to_read(buffer, static_cast<size_t>(packed.numel()) * size_of(packed.dtype()));
}

void read_rows_on_host(const Tensor& tensor, int64_t begin, int64_t end,
                       const std::function<void(std::span<const std::byte>)>& use) {
  use_rows(tensor, begin, end, HostUse::read, use);
}

void change_rows_on_host(const Tensor& tensor, int64_t begin, int64_t end,
                         const std::function<void(std::span<std::byte>)>& use) {
  use_rows(tensor, begin, end, HostUse::change, use);
}

void overwrite_rows_on_host(const Tensor& tensor, int64_t begin, int64_t end,
                            const std::function<void(std::span<std::byte>)>& fill) {
  use_rows(tensor, begin, end, HostUse::overwrite, fill);
}

}  // namespace cloam
