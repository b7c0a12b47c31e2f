// Cumulative sums along an axis. Long rows run in parallel, in chunks whose length depends on the device class alone.
#include "runtime/ops/scan.h"

#include "runtime/cl.h"
#include "runtime/ops/share.h"

namespace cloam {

void scan_rows(const Tensor& in, const Tensor& out, int64_t rows, const Cumulative& how) {
  if (in.numel() == 0) return;
  const Variant& v = choose("scan");
  const int64_t n = in.numel() / rows, length = v["LENGTH"], chunks = (n + length - 1) / length;
  const int64_t pieces = rows * chunks;
  const Constants type = {{"INTEGER", in.dtype() == DType::f32 ? 0 : 1}};
  const WorkShare work = share(pieces, 4096 / std::min(n, length));
  Tensor bases = in;
  if (chunks > 1) {
    const Tensor sums = empty({rows, chunks}, in.dtype());
    bases = empty({rows, chunks}, in.dtype());
    launch(kernel(v.stem.c_str(), "chunk_sums", type), "chunk_sums", work.range, in, sums, pieces, n, chunks, length,
           int{how.reverse}, work.chunk);
    scan_rows(sums, bases, rows, {.exclusive = true});
  }
  const bool past = static_cast<uint64_t>(out.numel()) * 4 > device().cache_bytes && n % 16 == 0;
  launch(kernel(v.stem.c_str(), "scan_chunks", type), "scan_chunks", work.range, in, bases, out, pieces, n, chunks,
         length, int{how.reverse}, int{how.exclusive}, work.chunk, int{past});
}

namespace {

const Registered kScanKernels("cumsum");

/// Along the last axis.
struct Cumsum final : Op {
  explicit Cumsum(const Cumulative& which) : how(which) {}
  const char* name() const override { return "cumsum"; }
  void run(const Tensors& in, Tensor& out) const override { scan_rows(in[0], out, out.numel() / out.dim(-1), how); }
  /// out_i sums the x_j with j <= i, so x_j reaches the out_i with i >= j: the sum from the other end.
  Tensors vjp(const Tensors&, const Tensor&, const Tensor& g) const override {
    return {cumsum(g, -1, {how.exclusive, !how.reverse})};
  }
  Cumulative how;
};

}  // namespace

Tensor cumsum(const Tensor& x, int axis, const Cumulative& how) {
  const int on = axis_of("cumsum", x.rank(), axis), last = x.rank() - 1;
  if (x.dtype() != DType::f32 && x.dtype() != DType::i32)
    throw Error(Fault::internal, text("[cumsum] x is ", name_of(x.dtype()), ", want float32 or int32"));
  if (on != last) return transpose(cumsum(transpose(x, on, last), last, how), on, last);
  return make(std::make_shared<Cumsum>(how), x.shape(), {x}, x.dtype());
}

int32_t value_at(const Tensor& values, int64_t place) {
  int32_t value = 0;
  read_buffer(*values.node()->storage.buffer, static_cast<size_t>(place) * 4, 4, &value);
  return value;
}

}  // namespace cloam
