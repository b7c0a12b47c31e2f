// Collapsing: the fewest axes that still describe how every input is walked.
#include "runtime/fuse.h"

namespace cloam {

int Layout::inner_kind(size_t input) const {
  const int64_t stride = strides[input].back();
  return stride == 0 ? 0 : stride == 1 ? 1 : 2;
}

int64_t Layout::reduced_count() const {
  int64_t count = 1;
  for (int i = 0; i < extents.rank(); i++)
    if (reduced >> i & 1u) count *= extents[i];
  return count;
}

int64_t Layout::kept_count() const {
  int64_t count = 1;
  for (int i = 0; i < extents.rank(); i++)
    if (!(reduced >> i & 1u)) count *= extents[i];
  return count;
}

uint64_t Layout::key() const {
  uint64_t out =
      static_cast<uint64_t>(extents.rank()) | static_cast<uint64_t>(serial) << 4 | static_cast<uint64_t>(reduced) << 5;
  for (size_t i = 0; i < inputs; i++) out = out * 3 + static_cast<uint64_t>(inner_kind(i));
  return out << kMaxOutputs | in_place;
}

namespace {

using Strides = std::array<Shape, kMaxInputs>;

Shape expanded(const Storage& storage, const Shape& from, const Shape& to) {
  Shape strides = Shape::filled(to.rank(), 0);
  for (int i = 1; i <= from.rank(); i++)
    if (from[from.rank() - i] != 1) strides[to.rank() - i] = storage.strides[from.rank() - i];
  return strides;
}

bool joins(const Strides& strides, const Layout& layout, int axis, int64_t extent) {
  for (size_t i = 0; i < layout.inputs; i++)
    if (layout.strides[i].back() != strides[i][axis] * extent) return false;
  return true;
}

void append(Layout& layout, const Strides& strides, int axis, int64_t extent, bool reduced) {
  if (reduced) layout.reduced |= 1u << layout.extents.rank();
  layout.extents.push_back(extent);
  for (size_t i = 0; i < layout.inputs; i++) layout.strides[i].push_back(strides[i][axis]);
}

}  // namespace

Layout collapse(const Shape& shape, std::span<Node* const> inputs, uint32_t reduced_axes) {
  Strides strides;
  Layout out;
  out.inputs = inputs.size();
  for (size_t i = 0; i < inputs.size(); i++) strides[i] = expanded(inputs[i]->storage, inputs[i]->shape, shape);
  for (int axis = 0; axis < shape.rank(); axis++) {
    if (shape[axis] == 1) continue;
    const bool reduced = reduced_axes >> axis & 1u;
    const int last = out.extents.rank() - 1;
    if (last >= 0 && (out.reduced >> last & 1u) == static_cast<uint32_t>(reduced) &&
        joins(strides, out, axis, shape[axis])) {
      out.extents[last] *= shape[axis];
      for (size_t i = 0; i < out.inputs; i++) out.strides[i][last] = strides[i][axis];
    } else {
      append(out, strides, axis, shape[axis], reduced);
    }
  }
  if (out.extents.rank() == 0) {
    out.extents.push_back(1);
    for (size_t i = 0; i < out.inputs; i++) out.strides[i].push_back(0);
    if (reduced_axes) out.reduced = 1;
  }
  out.serial = reduced_axes != 0 && out.inner_reduced() && out.reduced_count() <= kSerialReduce;
  return out;
}

}  // namespace cloam
