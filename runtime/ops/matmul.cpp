// Matrix products over strided operands: transposed and sliced views are read where they lie.
#include <algorithm>

#include "runtime/cl.h"
#include "runtime/ops/ceil_div.h"
#include "runtime/ops/epilogue.h"

namespace cloam {
namespace {

const Registered kMatmul("matmul"), kLinear("linear");

int64_t padded(int64_t n, int64_t unit) { return ceil_div(n, unit) * unit; }

/// An operand as the kernels walk it: one stride over the flattened batch, and those of its two inner axes.
struct MatrixOperand {
  Tensor tensor;
  int64_t batch = 0, row = 0, column = 0;
};

/// The strides of `x` spread over the batch axes of the result (0 where it is broadcast), then its own two.
Shape spread_strides(const Tensor& x, int rank) {
  Shape strides = Shape::filled(rank, 0);
  for (int i = 1; i <= x.rank(); i++)
    if (i <= 2 || x.dim(-i) != 1) strides[rank - i] = x.node()->storage.strides[x.rank() - i];
  return strides;
}

/// One stride that walks all batch axes, or nothing.
std::optional<int64_t> batch_stride(const Shape& strides, const Shape& extents) {
  std::optional<int64_t> inner;
  int64_t next = 0;
  for (int i = extents.rank() - 3; i >= 0; i--) {
    if (extents[i] == 1) continue;
    if (inner && strides[i] != next) return std::nullopt;
    if (!inner) inner = strides[i];
    next = strides[i] * extents[i];
  }
  return inner.value_or(0);
}

/// `out` gives the batch axes. Packs a copy when the batch has no single stride, or neither inner axis is contiguous.
MatrixOperand operand(const Tensor& x, const Shape& out) {
  Shape extents = out;
  extents[out.rank() - 2] = x.dim(-2);
  extents[out.rank() - 1] = x.dim(-1);
  const Shape strides = spread_strides(x, out.rank());
  const int64_t row = strides[out.rank() - 2], column = strides.back();
  const bool contiguous = row == 1 || column == 1 || x.dim(-1) == 1 || x.dim(-2) == 1;
  if (!contiguous) return operand(dense(x), out);
  if (const auto stride = batch_stride(strides, extents)) return {x, *stride, row, column};
  auto spread = std::make_shared<Node>();
  spread->shape = extents;
  spread->storage = {x.node()->storage.buffer, x.node()->storage.offset, strides};
  return operand(dense(Tensor(spread)), out);
}

/// c = end of a b; bias and residual are empty where the epilogue's flags say nothing of them.
struct Problem {
  MatrixOperand a, b;
  Tensor c, bias, residual;
  int epilogue = 0;
  int64_t batch, m, n, k;
  double flops() const { return 2.0 * static_cast<double>(batch * m) * static_cast<double>(n * k); }
  /// Which of the two inner axes lies side by side; a lone row or column is either.
  bool a_by_column() const { return a.column != 1 && k != 1; }
  bool b_by_column() const { return b.column != 1 && n != 1; }
  int64_t a_pitch() const { return a_by_column() ? a.column : a.row; }
  int64_t b_pitch() const { return b_by_column() ? b.column : b.row; }
};

/// The long sums of few elements (weight gradients over many samples) are shared out in equal parts. A function of the
/// shape and the device class alone: it fixes the order of summation.
struct Splits {
  int64_t count = 1, k_each = 0;
};

Splits splits_of(const Problem& p) {
  const int64_t wanted_groups = is_cpu_class() ? 32 : 512, least_depth = is_cpu_class() ? 1024 : 256;
  const int64_t tiles = p.batch * ceil_div(p.m, 64) * ceil_div(p.n, is_cpu_class() ? 256 : 64);
  const int64_t wanted = std::clamp<int64_t>(wanted_groups / tiles, 1, std::max<int64_t>(1, p.k / least_depth));
  const int64_t k_each = padded(ceil_div(p.k, wanted), 256);
  return {ceil_div(p.k, k_each), k_each};
}

void run_reference(const Problem& p) {
  Range range = elements(p.m * p.n);
  range.global[1] = static_cast<size_t>(p.batch);
  range.flops = p.flops();
  launch(kernel("matmul", "matmul_reference"), "matmul_reference", range, Strided{p.a.tensor}, Strided{p.b.tensor}, p.c,
         p.m, p.n, p.k, p.a.batch, p.a.row, p.a.column, p.b.batch, p.b.row, p.b.column, p.bias, p.residual, p.epilogue);
}

void run_tiled(const Problem& p) {
  const Variant& variant = choose("matmul", std::min(p.m, p.n) >= 512 ? "large" : "any");
  const Constants layout = {{"A_BY_COLUMN", p.a_by_column()}, {"B_BY_COLUMN", p.b_by_column()}};
  const Splits s = splits_of(p);
  const int side = variant["LANES"] == 64 ? 8 : 16;  // of the square that a group is
  Range range = range2(ceil_div(p.n, side * variant["RN"]) * side, ceil_div(p.m, side * variant["RM"]) * side);
  range.global[2] = static_cast<size_t>(p.batch * s.count);
  range.local = {static_cast<size_t>(side), static_cast<size_t>(side), 1};
  range.flops = p.flops();
  const bool whole = s.count == 1;
  const Tensor to = whole ? p.c : empty({p.batch, s.count, p.m * p.n});
  launch(kernel(variant, layout), "matmul_tiled", range, Strided{p.a.tensor}, Strided{p.b.tensor}, to, p.m, p.n, p.k,
         p.a.batch, p.a_pitch(), p.b.batch, p.b_pitch(), s.count, s.k_each, p.bias, p.residual, whole ? p.epilogue : 0);
  if (whole) return;
  Variant adding = variant;
  adding.kernel = "add_splits";
  range = elements(p.m * p.n);
  range.global[1] = static_cast<size_t>(p.batch);
  launch(kernel(adding, layout), "add_splits", range, to, p.c, p.m, p.n, s.count, p.bias, p.residual, p.epilogue);
}

/// By the width of C and its height; "compact" where the packed panels of that choice would not fit the device.
const Variant& blocked_variant(const Problem& p) {
  const Variant& wished = choose("matmul", p.n <= 16 ? "thin" : p.n <= 32 ? "narrow" : p.m <= 128 ? "flat" : "wide");
  const int64_t floats = wished["KC"] * (wished["NC"] + 64) + 16 * wished["MR"] * wished["NV"] + 1024;
  return floats * 4 <= static_cast<int64_t>(device().local_bytes) ? wished : choose("matmul", "compact");
}

/// Rows a work-item takes: few enough to keep all cores busy, enough to make packing B worth while. Each element's sum
/// is its own, so this changes no bits.
int64_t rows_each(const Problem& p, int64_t column_groups, bool a_packed, int64_t unit) {
  const int64_t cores = std::max(1, device().compute_units), cheap = a_packed ? 128 : 256;
  int64_t rows = 512;
  const auto groups = [&] { return column_groups * ceil_div(p.m, rows); };
  while ((groups() < 8 * cores && rows > cheap) || (groups() < 2 * cores && rows > 32)) rows /= 2;
  return padded(ceil_div(p.m, ceil_div(p.m, rows)), unit);
}

void run_blocked(const Problem& p) {
  const Variant& variant = blocked_variant(p);
  // Columns of A that lie in few cache sets, or in many pages, are packed.
  const bool a_packed = p.a_by_column() && p.a_pitch() > 128;
  const Constants layout = {{"A_BY_COLUMN", p.a_by_column()}, {"B_BY_COLUMN", p.b_by_column()}, {"A_PACKED", a_packed}};
  const Splits s = splits_of(p);
  const int64_t nc = padded(ceil_div(p.n, ceil_div(p.n, variant["NC"])), 16 * variant["NV"]);
  const int64_t mc = rows_each(p, p.batch * s.count * ceil_div(p.n, nc), a_packed, a_packed ? 64 : variant["MR"]);
  Range range = range2(ceil_div(p.n, nc), ceil_div(p.m, mc));
  range.global[2] = static_cast<size_t>(p.batch * s.count);
  range.flops = p.flops();
  const bool whole = s.count == 1;
  const Tensor to = whole ? p.c : empty({p.batch, s.count, p.m * p.n});
  launch(kernel(variant, layout), "matmul_blocked", range, Strided{p.a.tensor}, Strided{p.b.tensor}, to, p.m, p.n, p.k,
         p.a.batch, p.a_pitch(), p.b.batch, p.b_pitch(), mc, nc, s.count, s.k_each, p.bias, p.residual,
         whole ? p.epilogue : 0);
  if (whole) return;
  Variant adding = variant;
  adding.kernel = "add_splits";
  const int64_t chunk = std::max<int64_t>(1, 1024 / p.n);
  launch(kernel(adding, layout), "add_splits", range2(ceil_div(p.m, chunk), p.batch), to, p.c, p.m, p.n, s.count, chunk,
         p.bias, p.residual, p.epilogue);
}

/// in: a, b, then the epilogue's tensors.
void run_product(const Tensors& in, const Tensor& out, int flags) {
  constexpr int64_t kTiny = 4 * 4 * 4;  // below, packing costs more than it saves
  const Problem p{operand(in[0], out.shape()),
                  operand(in[1], out.shape()),
                  out,
                  flags & kBias ? dense(in[2]) : out,
                  flags & kResidual ? dense(in.back()) : out,
                  flags,
                  numel(out.shape()) / (out.dim(-2) * out.dim(-1)),
                  out.dim(-2),
                  out.dim(-1),
                  in[0].dim(-1)};
  const bool tiny = p.k == 0 || (p.batch > 1 && p.m * p.n * p.k <= kTiny);
  if (runs_reference("matmul") || tiny) return run_reference(p);
  is_cpu_class() ? run_blocked(p) : run_tiled(p);
}

struct Matmul final : Op {
  const char* name() const override { return "matmul"; }
  bool strided_inputs() const override { return true; }
  void run(const Tensors& in, Tensor& out) const override { run_product(in, out, 0); }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {matmul(g, transpose(in[1])), matmul(transpose(in[0]), g)};
  }
};

/// x [S,K], w [K,N], then the epilogue's tensors.
struct Linear final : Op {
  explicit Linear(int epilogue) : flags(epilogue) {}
  const char* name() const override { return "linear"; }
  uint64_t key() const override { return static_cast<uint64_t>(flags); }
  bool strided_inputs() const override { return true; }
  void run(const Tensors& in, Tensor& out) const override { run_product(in, out, flags); }
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override {
    const Tensor through = before_epilogue(flags, out, g);
    Tensors of = {matmul(through, transpose(in[1])), matmul(transpose(in[0]), through)};
    if (flags & kBias) of.push_back(sum(through, {{0}}));
    if (flags & kResidual) of.push_back(through);
    return of;
  }
  int flags;
};

void check(const Tensor& a, const Tensor& b) {
  const std::string shapes = text("[matmul] ", to_string(a.shape()), " ", name_of(a.dtype()), " x ",
                                  to_string(b.shape()), " ", name_of(b.dtype()));
  if (a.dtype() != DType::f32 || b.dtype() != DType::f32)
    throw Error(Fault::internal, text(shapes, ": want float32 (cast() converts)"));
  if (a.rank() < 2 || b.rank() < 2)
    throw Error(Fault::internal, text(shapes, ": want [.., M, K] x [.., K, N]; unsqueeze() makes a vector a matrix"));
  if (a.dim(-1) != b.dim(-2))
    throw Error(Fault::internal,
                text(shapes, ": want [.., M, K] x [.., K, N]: K is ", a.dim(-1), " in a but ", b.dim(-2), " in b"));
}

Shape batch_of(const Tensor& x) {
  Shape batch;
  for (int i = 0; i + 2 < x.rank(); i++) batch.push_back(x.dim(i));
  return batch;
}

}  // namespace

Tensor matmul(const Tensor& a, const Tensor& b) {
  check(a, b);
  Shape shape = broadcast("matmul", batch_of(a), batch_of(b));
  shape.push_back(a.dim(-2));
  shape.push_back(b.dim(-1));
  // One matrix for a whole batch: the batch joins the rows, and the gradient of b is one long sum.
  if (b.rank() == 2 && a.rank() > 2 && a.numel() > 0)
    return reshape(matmul(reshape(a, {numel(batch_of(a)) * a.dim(-2), a.dim(-1)}), b), shape);
  return make(std::make_shared<Matmul>(), shape, {a, b});
}

Tensor linear_composed(const Tensor& x, const Tensor& w, const Epilogue& with) {
  return composed_epilogue(matmul(x, w), with.bias, with);
}

Tensor linear(const Tensor& x, const Tensor& w, const Epilogue& with) {
  const Dims d = match("linear", {{"w", w, "K N"}});
  Shape shape = x.shape();
  if (x.rank() < 2 || x.dim(-1) != d["K"])
    throw Error(Fault::internal, text("[linear] x has shape ", to_string(x.shape()), " and w ", to_string(w.shape()),
                                      ", want x [.., ", d["K"], "]"));
  shape[x.rank() - 1] = d["N"];
  if (with.bias && !(with.bias.shape() == Shape{d["N"]}))
    throw Error(Fault::internal,
                text("[linear] bias has shape ", to_string(with.bias.shape()), ", want [", d["N"], "]"));
  if (with.residual && !(with.residual.shape() == shape))
    throw Error(Fault::internal,
                text("[linear] residual has shape ", to_string(with.residual.shape()), ", want ", to_string(shape)));
  if (x.rank() > 2) {  // the batch joins the rows
    const Shape rows = {numel(batch_of(x)) * x.dim(-2), d["K"]};
    const Tensor residual = with.residual ? reshape(with.residual, {rows[0], d["N"]}) : Tensor();
    return reshape(linear(reshape(x, rows), w, {with.bias, residual, with.activation}), shape);
  }
  Tensors in = {x, w};
  if (with.bias) in.push_back(with.bias);
  if (with.residual) in.push_back(with.residual);
  if (!fuses(in, with)) return linear_composed(x, w, with);
  return make(std::make_shared<Linear>(epilogue_flags(with)), shape, in);
}

}  // namespace cloam
