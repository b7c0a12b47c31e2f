// Resizing images, an axis at a time: both filters are products of one for rows and one for columns.
#include "runtime/ops.h"
#include "runtime/ops/share.h"
#include "runtime/variant.h"

namespace cloam {
namespace {

const Registered kResizeKernels[] = {Registered("resize"), Registered("resize_adjoint")};

constexpr int64_t kLongest = 1 << 14;  // the kernels' positions are exact in 32 bits up to here
constexpr int64_t kLinesAtOnce = 16;   // LINES of resize.cl

/// Seen as [outer, from, inner], one axis becomes `to` long; the adjoint goes back. Each is the other's gradient.
struct Resize final : Op {
  Resize(bool with_bilinear, bool back, int on) : bilinear(with_bilinear), adjoint(back), axis(on) {}
  const char* name() const override { return adjoint ? "resize_adjoint" : "resize"; }
  void run(const Tensors& in, Tensor& out) const override {
    int64_t outer = 1, inner = 1;
    for (int i = 0; i < axis; i++) outer *= out.dim(i);
    for (int i = axis + 1; i < out.rank(); i++) inner *= out.dim(i);
    const int64_t small = (adjoint ? out : in[0]).dim(axis), large = (adjoint ? in[0] : out).dim(axis);
    const Variant& v = choose("resize", inner == 1 ? "lines" : "any");
    if (v.where == "cpu") return run_lines(in[0], out, outer);
    const int64_t pieces = row_pieces(outer * out.dim(axis), inner);
    const WorkShare work = share(pieces, 4096 / inner);
    launch(kernel("resize", name(), {{"BILINEAR", bilinear}}), name(), work.range, in[0], out, pieces, small, large,
           inner, work.chunk);
  }
  void run_lines(const Tensor& in, Tensor& out, int64_t lines) const {
    const int64_t from = (adjoint ? out : in).dim(axis), to = (adjoint ? in : out).dim(axis);
    const int64_t pieces = (lines + kLinesAtOnce - 1) / kLinesAtOnce;
    const WorkShare work = share(pieces, 4096 / (kLinesAtOnce * to));
    const char* which = adjoint ? "resize_lines_adjoint" : "resize_lines";
    launch(kernel("resize", which, {{"BILINEAR", bilinear}}), name(), work.range, in, out, pieces, lines, from, to,
           work.chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {make(std::make_shared<Resize>(bilinear, !adjoint, axis), in[0].shape(), {g})};
  }
  bool bilinear, adjoint;
  int axis;
};

Tensor along(const Tensor& x, int axis, int64_t to, bool bilinear) {
  if (x.dim(axis) == to) return x;
  Shape shape = x.shape();
  shape[axis] = to;
  return make(std::make_shared<Resize>(bilinear, false, axis), shape, {x});
}

Tensor resize(const char* op, const Tensor& x, int64_t height, int64_t width, bool bilinear) {
  const Dims d = match(op, {{"x", x, "N C H W"}});
  const auto fits = [](int64_t size) { return size >= 1 && size <= kLongest; };
  if (x.dtype() != DType::f32 || !fits(height) || !fits(width) || !fits(d["H"]) || !fits(d["W"]))
    throw Error(Fault::internal, text("[", op, "] ", to_string(x.shape()), " ", name_of(x.dtype()), " to ", height, "x",
                                      width, ": want float32, height and width from 1 to ", kLongest));
  // Along rows a number at a time is made, along columns a row at a time: rows go while there are few of them.
  if (height < d["H"]) return along(along(x, 2, height, bilinear), 3, width, bilinear);
  return along(along(x, 3, width, bilinear), 2, height, bilinear);
}

}  // namespace

Tensor resize_nearest(const Tensor& x, int64_t height, int64_t width) {
  return resize("resize_nearest", x, height, width, false);
}

Tensor resize_bilinear(const Tensor& x, int64_t height, int64_t width) {
  return resize("resize_bilinear", x, height, width, true);
}

}  // namespace cloam
