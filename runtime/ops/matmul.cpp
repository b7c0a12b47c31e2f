// Matrix products over strided operands: transposed and sliced views are read where they lie.
#include <algorithm>

#include "runtime/cl.h"
#include "runtime/ops/epilogue.h"

namespace cloam {
namespace {

const Registered kRegistered("matmul");

int64_t ceil_div(int64_t a, int64_t b) { return (a + b - 1) / b; }

/// An operand as the kernels walk it: one stride over the flattened batch, and those of its two inner axes.
struct Operand {
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
Operand operand(const Tensor& x, const Shape& out) {
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

struct Problem {
  Operand a, b;
  int64_t batch, m, n, k;
  double flops() const { return 2.0 * static_cast<double>(batch * m) * static_cast<double>(n * k); }
};

void run_any(const Problem& p, const Tensor& out) {
  const bool tiled = !is_cpu_class() && !reference_variants();
  Range range = elements(p.m * p.n);
  range.global[1] = static_cast<size_t>(p.batch);
  if (tiled) {
    range.local = {16, 16, 1};
    range.global = {static_cast<size_t>(ceil_div(p.n, 16) * 16), static_cast<size_t>(ceil_div(p.m, 16) * 16),
                    static_cast<size_t>(p.batch)};
  }
  range.flops = p.flops();
  const char* name = tiled ? "matmul_tiled" : "matmul_reference";
  launch(kernel("matmul", name), name, range, Strided{p.a.tensor}, Strided{p.b.tensor}, out, p.m, p.n, p.k, p.a.batch,
         p.a.row, p.a.column, p.b.batch, p.b.row, p.b.column);
}

/// How a product is cut for CPU devices: a function of the shape alone, so that sums have one order on every machine.
struct Tiling {
  int kc = 256, nc_max = 256, mr = 4, nv = 4;  // mr * nv + nv + 1 vectors: the 32 registers of AVX-512 hold them
  int64_t mc = 256, nc = 256, splits = 1, k_each = 0;
};

Tiling tiling(const Problem& p) {
  constexpr int64_t kGroups = 32, kLeastDepth = 1024;
  Tiling t;
  if (device().local_bytes < 300u << 10) t.kc = 32, t.nc_max = 64;
  if (p.n <= 32) t.mr = 8, t.nv = p.n <= 16 ? 1 : 2;
  t.nc = std::min<int64_t>(t.nc_max, p.n);
  const auto tiles = [&] { return p.batch * ceil_div(p.m, t.mc) * ceil_div(p.n, t.nc); };
  // Tall-and-skinny weight gradients have few tiles but a long sum: share out the sum.
  const int64_t wanted = std::clamp<int64_t>(kGroups / tiles(), 1, std::max<int64_t>(1, p.k / kLeastDepth));
  t.k_each = ceil_div(ceil_div(p.k, wanted), t.kc) * t.kc;
  t.splits = ceil_div(p.k, t.k_each);
  while (tiles() * t.splits < 2 * kGroups && t.mc > 32) t.mc /= 2;
  return t;
}

void run_blocked(const Problem& p, const Tensor& out) {
  const Tiling t = tiling(p);
  const bool a_by_column = p.a.column != 1 && p.k != 1, b_by_column = p.b.column != 1 && p.n != 1;
  const Constants constants = {{"MR", t.mr},
                               {"NV", t.nv},
                               {"KC", t.kc},
                               {"NC", t.nc_max},
                               {"A_BY_COLUMN", a_by_column},
                               {"B_BY_COLUMN", b_by_column}};
  Range range = range2(ceil_div(p.n, t.nc), ceil_div(p.m, t.mc));
  range.global[2] = static_cast<size_t>(p.batch * t.splits);
  range.flops = p.flops();
  const int64_t count = p.m * p.n;
  const Tensor to = t.splits == 1 ? out : empty({p.batch, t.splits, count});
  launch(kernel("matmul_cpu", "matmul_blocked", constants), "matmul_blocked", range, Strided{p.a.tensor},
         Strided{p.b.tensor}, to, p.m, p.n, p.k, p.a.batch, a_by_column ? p.a.column : p.a.row, p.b.batch,
         b_by_column ? p.b.column : p.b.row, t.mc, t.nc, t.splits, t.k_each);
  if (t.splits == 1) return;
  constexpr int64_t kChunk = 4096;
  launch(kernel("matmul_cpu", "add_splits", constants), "add_splits", range2(ceil_div(count, kChunk), p.batch), to, out,
         count, t.splits, kChunk);
}

struct Matmul final : Op {
  const char* name() const override { return "matmul"; }
  bool strided_inputs() const override { return true; }
  void run(const Tensors& in, Tensor& out) const override {
    const Problem p{operand(in[0], out.shape()),
                    operand(in[1], out.shape()),
                    numel(out.shape()) / (out.dim(-2) * out.dim(-1)),
                    out.dim(-2),
                    out.dim(-1),
                    in[0].dim(-1)};
    const bool tiny = p.batch > 1 && p.m * p.n * p.k <= kTiny;
    if (is_cpu_class() && !reference_variants() && p.k > 0 && !tiny)
      run_blocked(p, out);
    else
      run_any(p, out);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {matmul(g, transpose(in[1])), matmul(transpose(in[0]), g)};
  }
  static constexpr int64_t kTiny = 4 * 4 * 4;  // below, packing costs more than it saves
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

Tensor linear(const Tensor& x, const Tensor& w, const Epilogue& with) { return linear_composed(x, w, with); }

}  // namespace cloam
