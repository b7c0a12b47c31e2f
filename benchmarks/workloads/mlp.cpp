// The fused multilayer perceptron: four layers of 64, other widths, and the cost of a sample over three decades.
#include <cmath>

#include "benchmarks/workload.h"
#include "runtime/error.h"
#include "runtime/ops.h"
#include "runtime/ops/fields.h"

namespace cloam {
namespace {

struct Perceptron {
  std::vector<int64_t> widths;  // of the input, the hidden layers and the output
  int64_t samples;
  double flops() const {
    int64_t weights = 0;
    for (size_t i = 0; i + 1 < widths.size(); i++) weights += widths[i] * widths[i + 1];
    return 2.0 * static_cast<double>(weights) * static_cast<double>(samples);
  }
};

/// The samples first, then the weights, at deviations that keep the activations' size.
Tensors inputs(const Perceptron& p) {
  Tensors in{random_normal({p.samples, p.widths[0]}, {1})};
  for (size_t i = 0; i + 1 < p.widths.size(); i++) {
    const float deviation = std::sqrt(2.f / static_cast<float>(p.widths[i]));
    in.push_back(random_normal({p.widths[i], p.widths[i + 1]}, {2 + i}) * deviation);
  }
  eval(in);
  return in;
}

Run prepare_forward(const Perceptron& p) {
  const Tensors in = inputs(p), weights(in.begin() + 1, in.end());
  return [=] { eval({mlp(in[0], weights)}); };
}

/// The result and the gradients of samples and weights, given one of the result.
Run prepare_backward(const Perceptron& p) {
  Tensors in = inputs(p);
  for (Tensor& t : in) t = parameter(t.to_host(), t.shape());
  const Tensors weights(in.begin() + 1, in.end());
  const Tensor g = random_normal({p.samples, p.widths.back()}, {1, 1});
  eval({g});
  return [=] {
    const Tensor y = mlp(in[0], weights);
    Tensors results = grad(y, in, g);
    results.push_back(y);
    eval(results);
  };
}

void add(Workloads& all, const std::string& widths, const Perceptron& p, const std::vector<std::string>& peers) {
  const std::string name = text("mlp.", widths, ".", p.samples);
  all.push_back({name + ".fwd", p.flops(), 0, [p] { return prepare_forward(p); }, peers});
  all.push_back({name + ".fwdbwd", 3 * p.flops(), 0, [p] { return prepare_backward(p); }, peers});
}

}  // namespace

void add_mlp_workloads(Workloads& all) {
  for (int64_t samples : {65536, 1024, 8192, 1048576})
    add(all, "4x64", {{64, 64, 64, 64, 64}, samples},
        samples == 65536 ? std::vector<std::string>{"torch"} : std::vector<std::string>{});
  for (int64_t width : {16, 32, 48, 128}) add(all, text("4x", width), {std::vector<int64_t>(5, width), 65536}, {});
  add(all, "32x64x16", {{32, 64, 16}, 65536}, {});
  add(all, "32x64x64x3", {{32, 64, 64, 3}, 65536}, {});
  add(all, "31x32x3", {{31, 32, 3}, 65536}, {});
}

}  // namespace cloam
