// Views: other shapes and strides over the same buffer.
#include "runtime/error.h"
#include "runtime/op.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

const Registered kViewKernels[] = {Registered("reshape"), Registered("permute"), Registered("slice"),
                                   Registered("broadcast_to"), Registered("bitcast")};

struct ViewOp : Op {
  OpKind kind() const override { return OpKind::view; }
};

struct Reshape final : ViewOp {
  const char* name() const override { return "reshape"; }
  std::optional<Storage> view(const Storage& in, const Shape& from, const Shape& to) const override;
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override { return {reshape(g, in[0].shape())}; }
};

/// Strides of the new shape exist when each run of new axes covers a run of old ones that is itself contiguous.
std::optional<Storage> Reshape::view(const Storage& in, const Shape& from, const Shape& to) const {
  if (numel(to) == 0) return Storage{in.buffer, in.offset, dense_strides(to)};
  Shape sizes, strides;
  for (int i = 0; i < from.rank(); i++) {
    if (from[i] == 1) continue;
    const bool joins = sizes.rank() > 0 && strides.back() == in.strides[i] * from[i];
    if (joins) {
      sizes[sizes.rank() - 1] *= from[i];
      strides[strides.rank() - 1] = in.strides[i];
    } else {
      sizes.push_back(from[i]);
      strides.push_back(in.strides[i]);
    }
  }
  Storage out{in.buffer, in.offset, Shape::filled(to.rank(), 0)};
  if (numel(to) == 0) return out;
  int run = sizes.rank() - 1;
  int64_t left = run >= 0 ? sizes[run] : 1, step = run >= 0 ? strides[run] : 1;
  for (int i = to.rank() - 1; i >= 0; i--) {
    if (to[i] == 1) continue;
    if (left == 1 && run > 0) left = sizes[--run], step = strides[run];
    if (left % to[i] != 0) return std::nullopt;
    out.strides[i] = step;
    step *= to[i];
    left /= to[i];
  }
  return out;
}

struct Permute final : ViewOp {
  explicit Permute(const Shape& order) : axes(order) {}
  const char* name() const override { return "permute"; }
  std::optional<Storage> view(const Storage& in, const Shape& from, const Shape&) const override {
    Storage out = in;
    for (int i = 0; i < from.rank(); i++) out.strides[i] = in.strides[static_cast<int>(axes[i])];
    return out;
  }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor& g) const override {
    Shape inverse = axes;
    for (int i = 0; i < axes.rank(); i++) inverse[static_cast<int>(axes[i])] = i;
    return {permute(g, inverse)};
  }
  uint64_t key() const override {
    uint64_t out = 0;
    for (int64_t axis : axes) out = out * 8 + static_cast<uint64_t>(axis);
    return out;
  }
  Shape axes;
};

struct Slice final : ViewOp {
  Slice(int on, int64_t from, int64_t by) : axis(on), begin(from), step(by) {}
  const char* name() const override { return "slice"; }
  std::optional<Storage> view(const Storage& in, const Shape&, const Shape&) const override {
    Storage out = in;
    out.offset += begin * in.strides[axis];
    out.strides[axis] *= step;
    return out;
  }
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override;
  uint64_t key() const override { return static_cast<uint64_t>(axis); }
  int axis;
  int64_t begin, step;
};

/// The adjoint of a strided slice: spread with zeros between, then pad.
Tensors Slice::vjp(const Tensors& in, const Tensor& out, const Tensor& g) const {
  Tensor spread = g;
  int64_t covered = out.shape()[axis];
  if (step > 1 && covered > 0) {
    Tensor wide = pad(unsqueeze(g, axis + 1), axis + 1, 0, step - 1);
    Shape flat = out.shape();
    flat[axis] = covered * step;
    covered = (covered - 1) * step + 1;
    spread = slice(reshape(wide, flat), axis, 0, covered);
  }
  return {pad(spread, axis, begin, in[0].shape()[axis] - begin - covered)};
}

struct Broadcast final : ViewOp {
  const char* name() const override { return "broadcast_to"; }
  std::optional<Storage> view(const Storage& in, const Shape& from, const Shape& to) const override {
    Storage out{in.buffer, in.offset, Shape::filled(to.rank(), 0)};
    for (int i = 1; i <= from.rank(); i++)
      if (from[from.rank() - i] != 1) out.strides[to.rank() - i] = in.strides[from.rank() - i];
    return out;
  }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor& g) const override { return {g}; }
};

struct Bitcast final : ViewOp {
  const char* name() const override { return "bitcast"; }
  std::optional<Storage> view(const Storage& in, const Shape&, const Shape&) const override { return in; }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override { return {Tensor()}; }
};

template <class V, class... Args>
Tensor view_of(const Tensor& x, const Shape& shape, Args... args) {
  return make(std::make_shared<V>(args...), shape, {x}, x.dtype());
}

Shape with_inferred(const Tensor& x, Shape shape) {
  int open = -1;
  int64_t known = 1;
  for (int i = 0; i < shape.rank(); i++) {
    if (shape[i] == -1 && open < 0)
      open = i;
    else
      known *= shape[i];
  }
  if (open >= 0 && known > 0) shape[open] = x.numel() / known;
  if (open >= 0 && known == 0) shape[open] = 0;
  if (numel(shape) != x.numel())
    throw Error(Fault::internal, text("[reshape] ", to_string(x.shape()), " has ", x.numel(), " elements, ",
                                      to_string(shape), " wants ", numel(shape)));
  return shape;
}

}  // namespace

Tensor reshape(const Tensor& x, const Shape& shape) {
  const Shape to = with_inferred(x, shape);
  return to == x.shape() ? x : view_of<Reshape>(x, to);
}

Tensor permute(const Tensor& x, const Shape& axes) {
  Shape to = x.shape(), order = axes;  // of the axes counted from the front
  bool complete = axes.rank() == x.rank();
  for (int i = 0; complete && i < x.rank(); i++) {
    const int axis = axis_of("permute", x.rank(), static_cast<int>(axes[i]));
    order[i] = axis;
    to[i] = x.shape()[axis];
    for (int j = 0; j < i; j++) complete &= order[i] != order[j];
  }
  if (!complete)
    throw Error(Fault::internal,
                text("[permute] ", to_string(axes), " is not an order of the axes of ", to_string(x.shape())));
  return view_of<Permute>(x, to, order);
}

Tensor transpose(const Tensor& x, int axis_a, int axis_b) {
  Shape axes = x.shape();
  for (int i = 0; i < axes.rank(); i++) axes[i] = i;
  const int a = axis_of("transpose", x.rank(), axis_a), b = axis_of("transpose", x.rank(), axis_b);
  std::swap(axes[a], axes[b]);
  return permute(x, axes);
}

Tensor slice(const Tensor& x, int axis, int64_t begin, int64_t end, int64_t step) {
  const int on = axis_of("slice", x.rank(), axis);
  const int64_t size = x.dim(on);
  if (begin < 0 || end > size || begin > end || step < 1)
    throw Error(Fault::internal,
                text("[slice] ", begin, ":", end, ":", step, " does not fit axis ", on, " of ", to_string(x.shape())));
  if (begin == 0 && end == size && step == 1) return x;
  Shape to = x.shape();
  to[on] = (end - begin + step - 1) / step;
  return view_of<Slice>(x, to, on, begin, step);
}

Tensor broadcast_to(const Tensor& x, const Shape& shape) {
  if (x.shape() == shape) return x;
  (void)numel(shape);  // a shape that no tensor has is told here, not where values are asked for
  if (!(broadcast("broadcast_to", x.shape(), shape) == shape))
    throw Error(Fault::internal,
                text("[broadcast_to] ", to_string(x.shape()), " does not broadcast to ", to_string(shape)));
  return view_of<Broadcast>(x, shape);
}

Tensor unsqueeze(const Tensor& x, int axis) {
  const int at = axis_of("unsqueeze", x.rank() + 1, axis);
  Shape to;
  for (int i = 0; i <= x.rank(); i++) {
    if (i == at) to.push_back(1);
    if (i < x.rank()) to.push_back(x.shape()[i]);
  }
  return reshape(x, to);
}

Tensor bitcast(const Tensor& x, DType dtype) {
  if (size_of(dtype) != size_of(x.dtype()))
    throw Error(Fault::internal, text("[bitcast] ", name_of(x.dtype()), " to ", name_of(dtype), ": sizes differ"));
  return x.dtype() == dtype ? x : make(std::make_shared<Bitcast>(), x.shape(), {x}, dtype);
}

Tensor full(const Shape& shape, float value) { return broadcast_to(Tensor(value), shape); }
Tensor zeros(const Shape& shape) { return full(shape, 0.f); }
Tensor ones(const Shape& shape) { return full(shape, 1.f); }

}  // namespace cloam
