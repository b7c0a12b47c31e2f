// Rows of a table by number, and the transpose: rows that share a number are summed, always in one order.
#include <bit>

#include "runtime/ops.h"
#include "runtime/ops/segments.h"
#include "runtime/ops/share.h"

namespace cloam {
namespace {

const Registered kIndexKernels[] = {Registered("gather_rows"), Registered("scatter_add_rows")};

struct GatherRows final : Op {
  const char* name() const override { return "gather_rows"; }
  void run(const Tensors& in, Tensor& out) const override {
    const int64_t width = row_width(in[0].shape()), pieces = row_pieces(in[1].numel(), width);
    const Constants form = {{"BYTES", static_cast<int>(size_of(out.dtype()))}, {"WIDTH", width == 1}};
    const WorkShare work = share(pieces, 8192 / width);
    launch(kernel("index", "gather_rows", form), name(), work.range, in[0], in[1], out, pieces, in[0].dim(0), width,
           work.chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    Shape flat = in[0].shape();
    flat[0] = in[1].numel();
    return {scatter_add_rows(reshape(g, flat), reshape(in[1], {flat[0]}), in[0].dim(0)), Tensor()};
  }
};

constexpr int64_t kFewValues = 4096, kSmallTable = 1 << 16;  // numbers: clearing and adding take less than a sort

/// Copies for scatter_add_rows by chunks of its values: a function of sizes and device class alone, so that the order
/// of summation is fixed. None when the table is too long for it.
int64_t copies_for(int64_t n, int64_t width, int64_t count) {
  const bool cpu = is_cpu_class();
  if (cpu && n * width <= kFewValues && count * width <= kSmallTable) return 1;
  const int64_t wanted = cpu ? std::clamp<int64_t>(n * width / 4096, 1, 32) : std::clamp<int64_t>(n / 64, 1, 1024);
  if (!cpu && count > 4096) return 0;  // a lane would clear its column of every copy
  const int64_t fit = (2 * n + 1024) / std::max<int64_t>(1, count), least = cpu ? 4 : 64;
  return fit < std::min(wanted, least) ? 0 : std::min(wanted, fit);
}

struct ScatterByCopies final : Op {
  explicit ScatterByCopies(int64_t copies) : parts(copies) {}
  const char* name() const override { return "scatter_add_rows"; }
  void run(const Tensors& in, Tensor& out) const override {
    const int64_t n = in[0].dim(0), count = out.dim(0), width = row_width(out.shape()),
                  pieces = row_pieces(parts, width);
    const Constants form = {{"BYTES", 4}, {"WIDTH", 0}};
    const Tensor copies = parts == 1 ? out : empty({parts, out.numel()});
    launch(kernel("index", "scatter_copies", form), name(), range1(pieces, is_cpu_class() ? 1 : 64), in[0], in[1],
           copies, pieces, n, count, width, (n + parts - 1) / parts);
    if (parts == 1) return;
    const WorkShare work = share(out.numel(), 1024);
    launch(kernel("index", "add_copies", form), "add_copies", work.range, copies, out, out.numel(), parts, work.chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {gather_rows(g, in[1]), Tensor()};
  }
  int64_t parts;
};

/// For long tables: the values in the order of their rows, each run summed. `rows` inside the table.
struct ScatterBySort final : Op {
  const char* name() const override { return "scatter_add_rows"; }
  uint64_t key() const override { return 1; }
  void run(const Tensors& in, Tensor& out) const override { sum_segments(in[0], in[2], in[3], out); }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {gather_rows(g, in[1]), Tensor(), Tensor(), Tensor()};
  }
};

Tensor scatter_by_sort(const Tensor& values, const Tensor& rows, const Shape& shape) {
  const auto last = static_cast<int>(shape[0] - 1);
  const Tensor inside = clamp(rows, 0, last);
  const Sorted sorted = sort(inside, std::max(1, static_cast<int>(std::bit_width(static_cast<uint64_t>(last)))));
  const Tensor offsets = segment_offsets(sorted.keys, shape[0]);
  return make(std::make_shared<ScatterBySort>(), shape, {values, inside, sorted.order, offsets});
}

void check_rows(const char* op, const Tensor& rows) {
  if (rows.dtype() != DType::i32)
    throw Error(Fault::internal, text("[", op, "] rows is ", name_of(rows.dtype()), ", want int32"));
}

}  // namespace

Tensor gather_rows(const Tensor& table, const Tensor& rows) {
  check_rows("gather_rows", rows);
  if (table.rank() == 0 || (table.dim(0) == 0 && rows.numel() > 0))
    throw Error(Fault::internal, text("[gather_rows] table ", to_string(table.shape()), " has no rows to choose from"));
  Shape shape = rows.shape();
  for (int i = 1; i < table.rank(); i++) shape.push_back(table.shape()[i]);
  return make(std::make_shared<GatherRows>(), shape, {table, rows}, table.dtype());
}

Tensor scatter_add_rows(const Tensor& values, const Tensor& rows, int64_t count) {
  check_rows("scatter_add_rows", rows);
  if (values.rank() == 0 || rows.rank() != 1 || values.dim(0) != rows.dim(0) || values.dtype() != DType::f32 ||
      (count < 1 && rows.numel() > 0))
    throw Error(Fault::internal, text("[scatter_add_rows] values ", to_string(values.shape()), " ",
                                      name_of(values.dtype()), " go by rows ", to_string(rows.shape()), " into ", count,
                                      " rows: want float32 values [n, ...], rows [n], one row at least"));
  Shape shape = values.shape();
  shape[0] = count;
  const int64_t parts = copies_for(values.dim(0), row_width(shape), count);
  if (parts == 0) return scatter_by_sort(values, rows, shape);
  return make(std::make_shared<ScatterByCopies>(parts), shape, {values, rows});
}

}  // namespace cloam
