// Reverse pass over the lazy graph: every step is an op's own vjp, so the result is a graph again.
#include <algorithm>
#include <unordered_map>

#include "runtime/device_lock.h"
#include "runtime/error.h"
#include "runtime/op.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

/// Tracked nodes in an order in which every node follows its inputs (an explicit stack: graphs are deep).
std::vector<Tensor> tracked_order(const Tensor& root) {
  std::vector<Tensor> order;
  std::unordered_map<Node*, bool> seen;  // false: on the stack, true: placed
  std::vector<std::pair<Tensor, size_t>> stack;
  if (root.tracked()) stack.push_back({root, 0}), seen[root.node()] = false;
  while (!stack.empty()) {
    auto& [tensor, next] = stack.back();
    if (next < tensor.node()->in.size()) {
      const Tensor input = tensor.node()->in[next++];
      if (input.tracked() && seen.emplace(input.node(), false).second) stack.push_back({input, 0});
    } else {
      order.push_back(tensor);
      stack.pop_back();
    }
  }
  return order;
}

void accumulate(std::unordered_map<Node*, Tensor>& grads, const Tensor& input, const Tensor& part) {
  const Tensor fitted = sum_to(part, input.shape());  // undoes broadcasting once, for every op
  auto [at, fresh] = grads.emplace(input.node(), fitted);
  if (!fresh) at->second = at->second + fitted;
}

Tensors with_zeros(Tensors gradients, const Tensors& wrt) {
  for (size_t i = 0; i < wrt.size(); i++)
    if (!gradients[i]) gradients[i] = zeros(wrt[i].shape());
  return gradients;
}

/// Empty handles where nothing arrives.
Tensors walk_back(const Tensor& out, const Tensors& wrt, const Tensor& g) {
  if (!(out.shape() == g.shape()))
    throw Error(Fault::internal, text("[grad] out has shape ", to_string(out.shape()), " but its gradient ",
                                      to_string(g.shape()), ", want the same"));
  const DeviceLock lock;  // an evaluation forgets where untracked nodes came from
  std::unordered_map<Node*, Tensor> grads;
  grads.emplace(out.node(), g);
  const std::vector<Tensor> order = tracked_order(out);
  for (auto t = order.rbegin(); t != order.rend(); ++t) {
    Node* node = t->node();
    auto found = grads.find(node);
    if (!node->op || found == grads.end()) continue;
    const Tensors parts = node->op->vjp(node->in, *t, found->second);
    for (size_t i = 0; i < parts.size(); i++)
      if (parts[i] && node->in[i].tracked()) accumulate(grads, node->in[i], parts[i]);
  }
  Tensors result;
  for (const Tensor& w : wrt) {
    auto found = grads.find(w.node());
    result.push_back(found == grads.end() ? Tensor() : broadcast_to(found->second, w.shape()));
  }
  return result;
}

}  // namespace

void eval_for_gradient(const Tensors& outputs) {
  const DeviceLock lock;
  Tensors all = outputs;
  for (const Tensor& output : outputs)
    for (const Tensor& t : tracked_order(output))
      if (t.node()->op && t.node()->op->kind() == OpKind::kernel && !t.evaluated()) all.push_back(t);
  eval(all);
}

Tensors grad_where_reached(const Tensor& loss, const Tensors& wrt) {
  if (loss.numel() != 1)
    throw Error(Fault::internal,
                text("[grad] the loss must be one value, got shape ", to_string(loss.shape()), ": sum or mean it"));
  return walk_back(loss, wrt, broadcast_to(Tensor(1.f), loss.shape()));
}

Tensors grad(const Tensor& loss, const Tensors& wrt) { return with_zeros(grad_where_reached(loss, wrt), wrt); }

Tensors grad(const Tensor& out, const Tensors& wrt, const Tensor& g) { return with_zeros(walk_back(out, wrt, g), wrt); }

}  // namespace cloam
