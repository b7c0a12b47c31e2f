// Attention of [batch, T, width] over as many keys.
#include "benchmarks/workload.h"
#include "runtime/error.h"
#include "runtime/op.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

Tensors inputs(const Shape& shape) {
  Tensors in;
  for (uint64_t seed : {1, 2, 3}) in.push_back(parameter(random_normal(shape, {seed}).to_host(), shape));
  return in;
}

Run prepare_forward(const Shape& shape) {
  const Tensors in = inputs(shape);
  return [=] { eval({attention(in[0], in[1], in[2])}); };
}

/// One pass, and all gradients for a given gradient of the result.
Run prepare_both(const Shape& shape) {
  const Tensors in = inputs(shape);
  const Tensor g = random_normal(shape, {4});
  eval({g});
  return [=] {
    Tensors all = {attention(in[0], in[1], in[2])};
    for (const Tensor& d : grad(all[0], in, g)) all.push_back(d);
    eval(all);
  };
}

/// Two products a pass; its gradient has five, of which one is the scores again.
void add(Workloads& all, const Shape& shape) {
  const std::string name = text("attention.", shape[0], "x", shape[1], "x", shape[2]);
  const double product = 2.0 * static_cast<double>(numel(shape)) * static_cast<double>(shape[1]);
  all.push_back({name + ".fwd", 2 * product, 0, [=] { return prepare_forward(shape); }, {"torch"}});
  all.push_back({name + ".fwdbwd", 7 * product, 0, [=] { return prepare_both(shape); }, {"torch"}});
}

}  // namespace

void add_attention_workloads(Workloads& all) {
  add(all, {4, 1024, 64});
  add(all, {4, 2048, 64});
  add(all, {64, 64, 64});  // a U-Net's 8 x 8 pixels, 8 images of 8 heads
}

}  // namespace cloam
