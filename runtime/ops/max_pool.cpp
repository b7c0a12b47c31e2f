// Max pooling. With the places of the largest values held fixed it is linear in the values found there: taking them
// from an image (pick) and adding to them (spread) are each other's adjoint, and pooling is x picked at its own places.
#include "runtime/ops.h"
#include "runtime/ops/share.h"
#include "runtime/variant.h"

namespace cloam {
namespace {

const Registered kMaxPoolKernels("max_pool2d");

/// in: x alone (pool), x and an image of its shape (pick), x and a value a window (spread).
struct MaxPool final : Op {
  enum class Part { pool, pick, spread };
  MaxPool(Part which, const Pooling& how) : part(which), with(how) {}
  const char* name() const override {
    return part == Part::pool ? "max_pool2d" : part == Part::pick ? "max_pool2d_pick" : "max_pool2d_spread";
  }
  void run(const Tensors& in, Tensor& out) const override;
  // The places change at ties alone, where no gradient is defined: none goes to x by way of them.
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    if (part == Part::pool) return {make_part(Part::spread, in[0].shape(), {in[0], g})};
    const Part back = part == Part::pick ? Part::spread : Part::pick;
    return {Tensor(), make_part(back, in[1].shape(), {in[0], g})};
  }
  Tensor make_part(Part which, const Shape& shape, const Tensors& in) const {
    return make(std::make_shared<MaxPool>(which, with), shape, in);
  }
  Part part;
  Pooling with;
};

void MaxPool::run(const Tensors& in, Tensor& out) const {
  if (out.numel() == 0) return;
  const Tensor &x = in[0], &values = in.back(), &pooled = part == Part::spread ? in[1] : out;
  const int64_t H = x.dim(2), W = x.dim(3), P = pooled.dim(2), Q = pooled.dim(3);
  const Variant& v = choose("max_pool");
  const Constants form = {
      {"WINDOW", with.window}, {"STRIDE", with.stride}, {"PAD", with.pad}, {"PLACES", part != Part::pool}};
  if (v.where == "cpu") {
    const int64_t planes = x.dim(0) * x.dim(1);
    const WorkShare work = share(planes, 4096 / (P * Q));
    const char* which = part == Part::spread ? "max_pool2d_spread_planes" : "max_pool2d_planes";
    launch(kernel(v, which, form), name(), work.range, x, values, out, planes, H, W, P, Q, work.chunk);
  } else {
    const char* which = part == Part::spread ? "max_pool2d_spread" : "max_pool2d";
    launch(kernel(v, which, form), name(), elements(out.numel()), x, values, out, out.numel(), H, W, P, Q);
  }
}

}  // namespace

int64_t Pooling::places(int64_t size) const {
  const int64_t room = size + 2 * pad - window, floor = room / stride + 1;
  // As Caffe and PyTorch: a last window that begins behind the image and its first zeros is none.
  return ceil && room % stride != 0 && floor * stride < size + pad ? floor + 1 : floor;
}

Tensor max_pool2d(const Tensor& x, const Pooling& with) {
  const Dims d = match("max_pool2d", {{"x", x, "N C H W"}});
  if (x.dtype() != DType::f32 || with.window < 1 || with.stride < 1 || with.pad < 0 || 2 * with.pad > with.window ||
      std::min(d["H"], d["W"]) + 2 * with.pad < with.window)
    throw Error(Fault::internal,
                text("[max_pool2d] ", to_string(x.shape()), " ", name_of(x.dtype()), ", window ", with.window,
                     ", stride ", with.stride, ", pad ", with.pad,
                     ": want float32, stride from 1, pad up to half the window, a window that fits the padded image"));
  return MaxPool(MaxPool::Part::pool, with)
      .make_part(MaxPool::Part::pool, {d["N"], d["C"], with.places(d["H"]), with.places(d["W"])}, {x});
}

}  // namespace cloam
