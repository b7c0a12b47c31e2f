// What is bound by memory or by launches: Adam, bias + ReLU, and a thousand small ops.
#include "benchmarks/workload.h"
#include "runtime/flat.h"
#include "runtime/ops.h"
#include "runtime/ops/adam.h"

namespace cloam {
namespace {

constexpr int64_t kOps = 1000, kSmall = 4096;

Tensor small_op(const Tensor& x, const Tensor& step, int64_t i) { return i % 2 == 0 ? x + step : x * step; }

/// A chain in which every op is recorded, evaluated and its result kept for the next: nothing can be fused.
Run one_by_one() {
  const Tensor start = random_normal({kSmall}, {1}), step = random_uniform({kSmall}, {2});
  eval({start, step});
  return [=] {
    Tensor x = start;
    for (int64_t i = 0; i < kOps; i++) {
      x = small_op(x, step, i);
      eval({x});
    }
  };
}

/// The same chain recorded whole and evaluated once.
Run in_one_graph() {
  const Tensor start = random_normal({kSmall}, {1}), step = random_uniform({kSmall}, {2});
  eval({start, step});
  return [=] {
    Tensor x = start;
    for (int64_t i = 0; i < kOps; i++) x = small_op(x, step, i);
    eval({x});
  };
}

Run bias_relu() {
  const Tensor x = random_normal({1 << 20, 64}, {1}), bias = random_normal({64}, {2});
  eval({x, bias});
  return [=] { eval({relu(x + bias)}); };
}

/// 10 million numbers in `tensors` parameters that lie side by side, as the optimiser of models/ keeps them.
Run adam(int64_t tensors) {
  const std::vector<Shape> shapes(static_cast<size_t>(tensors), Shape{10'000'000 / tensors});
  const Flat p = flat_zeros(shapes), m = flat_zeros(shapes), v = flat_zeros(shapes), g = flat_zeros(shapes);
  for (size_t i = 0; i < shapes.size(); i++) {
    const auto stream = static_cast<uint32_t>(i);
    put_at(random_normal(shapes[i], {1, 0, stream}), p.parts[i]);
    put_at(random_normal(shapes[i], {2, 0, stream}), g.parts[i]);
  }
  auto step = std::make_shared<int64_t>(0);
  return [p = p.all, m = m.all, v = v.all, g = g.all, step]() mutable { adam_step(p, m, v, g, {.step = ++*step}); };
}

}  // namespace

void add_stream_workloads(Workloads& all) {
  all.push_back({"pointwise.1000x4096", 0, 12.0 * kOps * kSmall, one_by_one, {}});
  all.push_back({"pointwise.1000x4096.fused", 0, 12.0 * kSmall, in_one_graph, {}});
  all.push_back({"bias_relu.64m", 0, 8.0 * (1 << 26), bias_relu, {"torch"}});
  all.push_back({"adam.10m", 0, 28e7, [] { return adam(1); }, {"torch"}});
  all.push_back({"adam.10m.100", 0, 28e7, [] { return adam(100); }, {}});
}

}  // namespace cloam
