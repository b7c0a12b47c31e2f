// Linear, small perceptrons, encodings.
#include "models/nn/layers.h"

#include <cmath>

#include "runtime/error.h"
#include "runtime/ops/fields.h"
namespace cloam {

Linear::Linear(const Scope& scope, int64_t in, int64_t out, float gain)
    : weight(scope.uniform("weight", {in, out}, gain * std::sqrt(6.f / static_cast<float>(in)))),
      bias(scope.constant("bias", {out}, 0.f)) {}

Tensor Linear::operator()(const Tensor& x, Activation activation) const {
  return linear(x, weight, {.bias = bias, .activation = activation});
}

SmallMlp::SmallMlp(const Scope& scope, const std::vector<int64_t>& sizes) {
  for (size_t i = 0; i + 1 < sizes.size(); i++)
    weights.push_back(scope.uniform("weight" + std::to_string(i), {sizes[i], sizes[i + 1]},
                                    std::sqrt(6.f / static_cast<float>(sizes[i]))));
}

Tensor SmallMlp::operator()(const Tensor& x) const { return mlp(x, weights); }

Tensor frequency_encoding(const Tensor& x, int count) {
  std::vector<float> scales;
  for (int i = 0; i < count; i++) scales.push_back(std::ldexp(1.f, i));
  const int64_t rows = x.dim(0), channels = x.dim(1);
  const Tensor angles = reshape(unsqueeze(x, 1) * from_host(scales, {count, 1}), {rows, count * channels});
  return concat({x, sin(angles), cos(angles)}, 1);
}

Tensor timestep_encoding(const Tensor& t, int64_t channels) {
  if (t.rank() != 1 || channels < 4 || channels % 2 != 0)
    throw Error(Fault::internal, text("[timestep_encoding] t ", to_string(t.shape()), ", ", channels,
                                      " channels: want t [N] and an even number of channels from 4"));
  const int64_t half = channels / 2;
  std::vector<float> rates;
  for (int64_t i = 0; i < half; i++)
    rates.push_back(static_cast<float>(std::pow(10000.0, -static_cast<double>(i) / static_cast<double>(half - 1))));
  const Tensor angles = unsqueeze(t, 1) * from_host(rates, {1, half});
  return concat({sin(angles), cos(angles)}, 1);
}

}  // namespace cloam
