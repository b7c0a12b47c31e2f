// Concat, split and pad: copies into a part of a larger tensor.
#include "runtime/cl.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

const Registered kJoinKernels[] = {Registered("concat"), Registered("pad")};

/// Seen as [outer, axis, inner], a part fills the rows [begin, begin + count) of the axis.
struct Rows {
  int64_t outer = 1, inner = 1;
};
Rows rows_around(const Shape& shape, int axis) {
  Rows rows;
  for (int i = 0; i < axis; i++) rows.outer *= shape[i];
  for (int i = axis + 1; i < shape.rank(); i++) rows.inner *= shape[i];
  return rows;
}

/// How a kernel of kernels/join.cl sees a part: `run` numbers of each of `outer` rows, at column `begin` of `pitch`.
struct Runs {
  int64_t outer, run, pitch, begin;
};

/// `what`: the size class. `items`: elements that the variant of GPU devices takes one by one.
void launch_runs(const char* what, const Tensor& in, const Tensor& out, const Runs& runs, int64_t items) {
  const Constants size = {{"BYTES", static_cast<int>(size_of(out.dtype()))}};
  const Variant& variant = choose("join", what);
  const char* const name = variant.kernel.c_str();
  if (variant.where == "gpu") {
    launch(kernel(variant, size), name, elements(items), in, out, items, runs.run, runs.pitch, runs.begin);
    return;
  }
  const int64_t per_item = is_cpu_class() ? std::max<int64_t>(1, 8192 / (items / runs.outer)) : 1;
  const Range range = range1((runs.outer + per_item - 1) / per_item, is_cpu_class() ? 1 : 64);
  launch(kernel(variant, size), name, range, in, out, runs.outer, runs.run, runs.pitch, runs.begin, per_item);
}

void copy_part(const Tensor& part, const Tensor& out, int axis, int64_t begin) {
  if (part.numel() == 0) return;
  const Rows rows = rows_around(out.shape(), axis);
  const int64_t run = part.dim(axis) * rows.inner, pitch = out.dim(axis) * rows.inner;
  launch_runs("concat", part, out, {rows.outer, run, pitch, begin * rows.inner}, part.numel());
}

struct Concat final : Op {
  explicit Concat(int on) : axis(on) {}
  const char* name() const override { return "concat"; }
  void run(const Tensors& in, Tensor& out) const override {
    int64_t begin = 0;
    for (const Tensor& part : in) {
      copy_part(part, out, axis, begin);
      begin += part.dim(axis);
    }
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    std::vector<int64_t> sizes;
    for (const Tensor& part : in) sizes.push_back(part.dim(axis));
    return split(g, axis, sizes);
  }
  int axis;
};

struct Pad final : Op {
  Pad(int on, int64_t front) : axis(on), before(front) {}
  const char* name() const override { return "pad"; }
  void run(const Tensors& in, Tensor& out) const override {
    if (out.numel() == 0) return;
    const Rows rows = rows_around(out.shape(), axis);
    const int64_t run = in[0].dim(axis) * rows.inner, pitch = out.dim(axis) * rows.inner;
    launch_runs("pad", in[0], out, {rows.outer, run, pitch, before * rows.inner}, out.numel());
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {slice(g, axis, before, before + in[0].dim(axis))};
  }
  int axis;
  int64_t before;
};

}  // namespace

Tensor concat(const Tensors& parts, int axis) {
  if (parts.empty()) throw Error(Fault::internal, "[concat] there is nothing to concatenate");
  const int on = axis_of("concat", parts[0].rank(), axis);
  Shape shape = parts[0].shape();
  shape[on] = 0;
  for (const Tensor& part : parts) {
    Shape others = part.shape();
    if (part.rank() != shape.rank() || part.dtype() != parts[0].dtype())
      throw Error(Fault::internal,
                  text("[concat] ", to_string(part.shape()), " ", name_of(part.dtype()), " does not join ",
                       to_string(parts[0].shape()), " ", name_of(parts[0].dtype())));
    others[on] = shape[on];
    if (!(others == shape))
      throw Error(Fault::internal, text("[concat] ", to_string(part.shape()), " differs from ",
                                        to_string(parts[0].shape()), " beyond axis ", on));
    shape[on] += part.dim(on);
  }
  return parts.size() == 1 ? parts[0] : make(std::make_shared<Concat>(on), shape, parts, parts[0].dtype());
}

Tensors split(const Tensor& x, int axis, const std::vector<int64_t>& sizes) {
  Tensors parts;
  int64_t begin = 0;
  for (int64_t size : sizes) {
    parts.push_back(slice(x, axis, begin, begin + size));
    begin += size;
  }
  if (begin != x.dim(axis))
    throw Error(Fault::internal, text("[split] the sizes add up to ", begin, ", axis ", axis, " of ",
                                      to_string(x.shape()), " has ", x.dim(axis)));
  return parts;
}

Tensor pad(const Tensor& x, int axis, int64_t before, int64_t after) {
  const int on = axis_of("pad", x.rank(), axis);
  if (before == 0 && after == 0) return x;
  if (before < 0 || after < 0)
    throw Error(Fault::internal, text("[pad] ", before, " before and ", after, " after: want none below 0"));
  Shape shape = x.shape();
  shape[on] += before + after;
  return make(std::make_shared<Pad>(on, before), shape, {x}, x.dtype());
}

}  // namespace cloam
