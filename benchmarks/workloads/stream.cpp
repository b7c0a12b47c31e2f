// What is bound by memory or by launches: Adam, bias + ReLU, and a thousand small ops.
#include "benchmarks/workload.h"
#include "runtime/ops.h"

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

/// `tensors` parameters of together 10 million numbers.
Run adam(int64_t tensors) {
  const int64_t each = 10'000'000 / tensors;
  Tensors p, m, v, g;
  for (int64_t i = 0; i < tensors; i++) {
    const auto stream = static_cast<uint32_t>(i);
    p.push_back(random_normal({each}, {1, 0, stream}));
    g.push_back(random_normal({each}, {2, 0, stream}));
    m.push_back(zeros({each}));
    v.push_back(zeros({each}));
  }
  eval(p);
  eval(g);
  auto step = std::make_shared<int64_t>(0);
  return [=]() mutable {
    ++*step;
    for (size_t i = 0; i < p.size(); i++) adam_step(p[i], m[i], v[i], g[i], {.step = *step});
  };
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
