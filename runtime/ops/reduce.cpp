// Sums, maxima, minima. The kernels are generated together with what feeds them: see fuse.cpp.
#include "runtime/ops/reduce.h"

#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {

static const Registered kReduceKernels[] = {Registered("sum"), Registered("max"), Registered("min")};

const char* ReduceOp::name() const {
  return reduction == Reduction::sum ? "sum" : reduction == Reduction::max ? "max" : "min";
}

Tensors ReduceOp::vjp(const Tensors& in, const Tensor& out, const Tensor& g) const {
  if (reduction == Reduction::sum) return {broadcast_to(g, in[0].shape())};
  // Sub-gradient: ties share.
  const Tensor hit = cast(equal(in[0], out), DType::f32);
  const Tensor ties = make(std::make_shared<ReduceOp>(Reduction::sum, axes), out.shape(), {hit});
  return {hit * (g / ties)};
}

namespace {

Tensor reduce(const Tensor& x, Reduction which, const Reduce& over) {
  uint32_t mask = 0;
  for (int axis : over.axes) mask |= 1u << axis_of("reduce", x.rank(), axis);
  if (over.axes.empty()) mask = (1u << x.rank()) - 1;
  Shape kept, dropped;
  for (int i = 0; i < x.rank(); i++) {
    const bool gone = mask >> i & 1u;
    kept.push_back(gone ? 1 : x.shape()[i]);
    if (!gone || over.keep) dropped.push_back(gone ? 1 : x.shape()[i]);
  }
  const DType dtype = x.dtype() == DType::f16 ? DType::f32 : x.dtype() == DType::u8 ? DType::i32 : x.dtype();
  const Tensor out = mask == 0 ? x : make(std::make_shared<ReduceOp>(which, mask), kept, {x}, dtype);
  return reshape(out, dropped);
}

}  // namespace

Tensor sum(const Tensor& x, const Reduce& over) { return reduce(x, Reduction::sum, over); }
Tensor max(const Tensor& x, const Reduce& over) { return reduce(x, Reduction::max, over); }
Tensor min(const Tensor& x, const Reduce& over) { return reduce(x, Reduction::min, over); }

Tensor mean(const Tensor& x, const Reduce& over) {
  const Tensor total = sum(x, over);
  return total * (static_cast<float>(total.numel()) / static_cast<float>(x.numel()));
}

Tensor sum_to(const Tensor& x, const Shape& shape) {
  if (x.shape() == shape) return x;
  Reduce over{{}, true};
  const int lead = x.rank() - shape.rank();
  for (int i = 0; i < x.rank(); i++)
    if (i < lead || (shape[i - lead] == 1 && x.shape()[i] != 1)) over.axes.push_back(i);
  return reshape(over.axes.empty() ? x : sum(x, over), shape);
}

}  // namespace cloam
