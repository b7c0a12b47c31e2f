// Tensors that lie one behind the other in one buffer, so that one launch can serve them all.
#pragma once
#include <functional>
#include <span>

#include "runtime/tensor.h"

namespace cloam {

/// `all` [n] f32 and the parts are the same memory: a change to one is seen through the other. The gaps between parts
/// (each begins where the device allows a buffer to begin) hold zeros at first.
struct Flat {
  Tensor all;
  Tensors parts;
  std::vector<int64_t> begins;  // of the parts in `all`, and its length
};
Flat flat_zeros(const std::vector<Shape>& shapes);
/// The same in memory of the host, at least flat_size() floats from the begin of a page on, with what is in it.
Flat flat_in(std::shared_ptr<std::byte> memory, const std::vector<Shape>& shapes);
/// Whether the device computes in such memory itself, so that who else has it sees what the device wrote. Tried out.
bool computes_in_host_memory();
/// How long `all` will be.
int64_t flat_size(const std::vector<Shape>& shapes);
/// Parts [begin, end) with the gaps between and behind them, [m], in the same memory.
Tensor joined(const Flat& flat, size_t begin, size_t end);

/// The value in memory of its own and no more than it needs, for what stays as long as the model: others get a little
/// more from the pool.
Tensor made_to_stay(const Tensor& value);
/// Gives `tensor` the memory of `place` (of its shape), with the values it has; nothing when it lies there already.
void move_to(const Tensor& tensor, const Tensor& place);
/// A hint: a pending value, when it is evaluated, shall be written straight into the memory of `place`. Then it is
/// overwritten when another value is put there.
void expect_at(const Tensor& value, const Tensor& place);
/// Evaluates `value` and copies it into the memory of `place`, unless the hint put it there.
void put_at(const Tensor& value, const Tensor& place);

/// Evaluates an f32 tensor and calls `use` with its values, row-major: in place where device and host share memory.
void read_on_host(const Tensor& tensor, const std::function<void(std::span<const float>)>& use);
/// Its values in place, as the device stores them, row-major, as long as the pointer lives; the tensor may be gone
/// then. Null where device and host share no memory, and of what may be written in place: parameters and what lies
/// flat.
std::shared_ptr<const std::byte> host_view(const Tensor& tensor);
/// Of rows [begin, end) of an evaluated and dense tensor, as the device stores them, in place where it can be.
void read_rows_on_host(const Tensor& tensor, int64_t begin, int64_t end,
                       const std::function<void(std::span<const std::byte>)>& use);
/// The same for rows that `use` reads and writes.
void change_rows_on_host(const Tensor& tensor, int64_t begin, int64_t end,
                         const std::function<void(std::span<std::byte>)>& use);
/// The same for rows that `fill` overwrites, all of them.
void overwrite_rows_on_host(const Tensor& tensor, int64_t begin, int64_t end,
                            const std::function<void(std::span<std::byte>)>& fill);

}  // namespace cloam
