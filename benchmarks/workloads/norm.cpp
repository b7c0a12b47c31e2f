// Normalisations: group norm with SiLU as U-Nets have it, layer norm and softmax over rows.
#include "benchmarks/workload.h"
#include "runtime/error.h"
#include "runtime/op.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

Tensor tracked_normal(const Shape& shape, uint64_t seed) {
  return parameter(random_normal(shape, {seed}).to_host(), shape);
}

/// One pass, or one with all gradients for a given gradient of the result.
template <class Forward>
Run forward_run(const Tensors& in, const Forward& forward) {
  eval(in);
  return [=] { eval({forward(in)}); };
}
template <class Forward>
Run both_run(const Tensors& in, const Shape& out, const Forward& forward) {
  const Tensor g = random_normal(out, {99});
  eval({g});
  return [=] {
    Tensors all = {forward(in)};
    for (const Tensor& d : grad(all[0], in, g)) all.push_back(d);
    eval(all);
  };
}

/// Names end in .fwd or .fwdbwd. A pass reads and writes x once; the gradient reads x and dy and writes dx.
template <class Forward>
void add(Workloads& all, const std::string& name, const std::vector<Shape>& shapes, const Forward& forward) {
  const auto inputs = [shapes] {
    Tensors in;
    for (const Shape& shape : shapes) in.push_back(tracked_normal(shape, in.size() + 1));
    return in;
  };
  const double bytes = 4.0 * static_cast<double>(numel(shapes[0]));
  const Shape out = shapes[0];
  all.push_back({name + ".fwd", 0, 2 * bytes, [=] { return forward_run(inputs(), forward); }, {"torch"}});
  all.push_back({name + ".fwdbwd", 0, 5 * bytes, [=] { return both_run(inputs(), out, forward); }, {"torch"}});
}

void add_group_norm(Workloads& all, const Shape& x) {
  const auto forward = [](const Tensors& in) { return group_norm(in[0], 32, in[1], in[2], {.silu = true}); };
  const std::string sizes = text(x[0], "x", x[1], "x", x[2], "x", x[3]);
  add(all, "groupnorm_silu." + sizes, {x, {x[1]}, {x[1]}}, forward);
}

void add_layer_norm(Workloads& all, const Shape& x) {
  const auto forward = [](const Tensors& in) { return layer_norm(in[0], in[1], in[2]); };
  add(all, text("layernorm.", x[0], "x", x[1]), {x, {x[1]}, {x[1]}}, forward);
}

void add_softmax(Workloads& all, const Shape& x) {
  const auto forward = [](const Tensors& in) { return softmax(in[0], -1); };
  add(all, text("softmax.", x[0], "x", x[1]), {x}, forward);
}

}  // namespace

void add_norm_workloads(Workloads& all) {
  add_group_norm(all, {8, 64, 128, 128});
  add_group_norm(all, {8, 256, 32, 32});
  add_layer_norm(all, {65536, 256});
  add_softmax(all, {65536, 256});
}

}  // namespace cloam
