#include "runtime/ops/composed.h"

#include "runtime/ops.h"

namespace cloam {
namespace {

/// Another name of a tensor.
struct Alias final : Op {
  const char* name() const override { return "alias"; }
  OpKind kind() const override { return OpKind::view; }
  std::optional<Storage> view(const Storage& in, const Shape&, const Shape&) const override { return in; }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor& g) const override { return {g}; }
};

Tensor leaf_like(const Tensor& x) {
  auto node = std::make_shared<Node>();
  node->shape = x.shape();
  node->dtype = x.dtype();
  node->tracked = true;
  return Tensor(std::move(node));
}

}  // namespace

// The inputs are leaves while grad() runs, so that it stops there; afterwards they become names of the real ones.
Tensors vjp_of(const Composition& composed, const Tensors& in, const Tensor& g) {
  Tensors leaves;
  for (const Tensor& x : in) leaves.push_back(leaf_like(x));
  const Tensors out = grad(composed(leaves), leaves, g);
  for (size_t i = 0; i < in.size(); i++) {
    leaves[i].node()->op = std::make_shared<Alias>();
    leaves[i].node()->in = {in[i]};
    leaves[i].node()->tracked = in[i].tracked();
  }
  return out;
}

Tensors vjp_of_gradient(const Composition& composed, size_t which, const Tensors& in, const Tensor& g) {
  const auto gradient = [&](const Tensors& of) {
    return vjp_of(composed, Tensors(of.begin(), of.end() - 1), of.back())[which];
  };
  return vjp_of(gradient, in, g);
}

Tensor packed(const Tensors& parts) {
  Tensors flat;
  for (const Tensor& part : parts) flat.push_back(reshape(part, {part.numel()}));
  return concat(flat, 0);
}

Tensors unpacked(const Tensor& all, const std::vector<Shape>& shapes) {
  Tensors parts;
  int64_t begin = 0;
  for (const Shape& shape : shapes) {
    parts.push_back(reshape(slice(all, 0, begin, begin + numel(shape)), shape));
    begin += numel(shape);
  }
  return parts;
}

}  // namespace cloam
