// Sums over segments: rows that lie one after another under one number.
#include "runtime/ops/segments.h"

#include "runtime/ops.h"
#include "runtime/ops/share.h"

namespace cloam {
namespace {

const Registered kSegmentsKernels[] = {Registered("segment_offsets"), Registered("segment_sum"),
                                       Registered("segment_spread")};

Constants form(bool ordered, int64_t width) { return {{"ORDERED", ordered}, {"WIDTH", width == 1}}; }

struct SegmentOffsets final : Op {
  const char* name() const override { return "segment_offsets"; }
  void run(const Tensors& in, Tensor& out) const override {
    const WorkShare work = share(out.numel(), 1024);
    launch(kernel("segments", "segment_offsets", form(false, 0)), name(), work.range, in[0], out, out.numel(),
           in[0].numel(), work.chunk);
  }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override { return {}; }
};

struct SegmentSum final : Op {
  const char* name() const override { return "segment_sum"; }
  void run(const Tensors& in, Tensor& out) const override { sum_segments(in[0], {}, in[1], out); }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {segment_spread(g, in[1], in[0].dim(0)), Tensor()};
  }
};

struct SegmentSpread final : Op {
  const char* name() const override { return "segment_spread"; }
  void run(const Tensors& in, Tensor& out) const override {
    const int64_t width = row_width(out.shape()), pieces = row_pieces(out.dim(0), width);
    const WorkShare work = share(pieces, 8192 / width);
    launch(kernel("segments", "segment_spread", form(false, width)), name(), work.range, in[0], in[1], out, pieces,
           in[0].dim(0), width, work.chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {segment_sum(g, in[1]), Tensor()};
  }
};

void check_segments(const char* op, const Tensor& values, const Tensor& offsets, bool fits) {
  if (!fits || values.dtype() != DType::f32 || offsets.dtype() != DType::i32 || offsets.rank() != 1 ||
      offsets.dim(0) < 1)
    throw Error(Fault::internal, text("[", op, "] values ", to_string(values.shape()), " ", name_of(values.dtype()),
                                      ", offsets ", to_string(offsets.shape()), " ", name_of(offsets.dtype()),
                                      ": want float32 rows and int32 offsets [segments + 1]"));
}

}  // namespace

void sum_segments(const Tensor& values, const Tensor& order, const Tensor& offsets, const Tensor& out) {
  const int64_t n = values.dim(0), width = row_width(out.shape()), count = out.dim(0);
  const int64_t length = is_cpu_class() ? std::max<int64_t>(1024, (n + 63) / 64) : 128,
                parts = std::max<int64_t>(1, (n + length - 1) / length);  // one, to clear what has no rows
  const Tensor heads = empty({parts, width});
  const Variant& v = choose("segments", "sum");
  if (v.where == "cpu") {
    const Constants rows = {{"ORDERED", bool{order}}, {"FLAT", !order && width > 0 && 16 % width == 0}};
    launch(kernel(v, rows), "segment_sum", range1(parts), values, order ? order : offsets, offsets, out, heads, parts,
           n, count, width, length);
    launch(kernel(v, "join_heads", rows), "join_heads", range1(parts), offsets, heads, out, parts, count, width,
           length);
    return;
  }
  const int64_t pieces = row_pieces(parts, width), joins = row_pieces(count, width);
  const WorkShare work = share(joins, 4096 / width);
  launch(kernel("segments", "segment_sum", form(bool{order}, 0)), "segment_sum",
         range1(pieces, is_cpu_class() ? 1 : 64), values, order ? order : offsets, offsets, out, heads, pieces, n,
         count, width, length);
  launch(kernel("segments", "join_heads", form(bool{order}, 0)), "join_heads", work.range, offsets, heads, out, joins,
         n, width, length, work.chunk);
}

Tensor segment_offsets(const Tensor& sorted_ids, int64_t count) {
  if (sorted_ids.rank() != 1 || sorted_ids.dtype() != DType::i32 || count < 0)
    throw Error(Fault::internal, text("[segment_offsets] ids ", to_string(sorted_ids.shape()), " ",
                                      name_of(sorted_ids.dtype()), " for ", count, " segments: want int32 [n]"));
  return make(std::make_shared<SegmentOffsets>(), {count + 1}, {sorted_ids}, DType::i32);
}

Tensor segment_sum(const Tensor& values, const Tensor& offsets) {
  check_segments("segment_sum", values, offsets, values.rank() > 0);
  Shape shape = values.shape();
  shape[0] = offsets.dim(0) - 1;
  return make(std::make_shared<SegmentSum>(), shape, {values, offsets});
}

Tensor segment_spread(const Tensor& of, const Tensor& offsets, int64_t n) {
  check_segments("segment_spread", of, offsets,
                 of.rank() > 0 && offsets.rank() == 1 && of.dim(0) + 1 == offsets.dim(0));
  Shape shape = of.shape();
  shape[0] = n;
  return make(std::make_shared<SegmentSpread>(), shape, {of, offsets});
}

}  // namespace cloam
