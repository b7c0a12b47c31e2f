// NeRF's network: `depth` layers of `width`, the encoded point again after the fifth, then density and a coloured view.
#include "models/fields/frequency_field.h"

#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr int kSkipAfter = 5;  // layers before the encoded point is given again

int64_t encoded_size(int frequencies) { return 3 * (1 + 2 * int64_t{frequencies}); }

}  // namespace

FrequencyField::FrequencyField(const Scope& scope, const FieldOptions& o)
    : options_(o),
      density_(scope / "density", o.width, 1),
      bottleneck_(scope / "bottleneck", o.width, o.width),
      view_(scope / "view", o.width + encoded_size(o.direction_frequencies), o.width / 2),
      colour_(scope / "colour", o.width / 2, 3) {
  const int64_t point = encoded_size(o.point_frequencies);
  for (int i = 0; i < o.depth; i++)
    layers_.emplace_back(scope / ("layer" + std::to_string(i)),
                         i == 0            ? point
                         : i == kSkipAfter ? o.width + point
                                           : int64_t{o.width},
                         o.width);
}

Tensor FrequencyField::trunk(const Tensor& points) const {
  const Tensor encoded = frequency_encoding(points * 2.f - 1.f, options_.point_frequencies);
  Tensor h = encoded;
  for (size_t i = 0; i < layers_.size(); i++)
    h = layers_[i](i == kSkipAfter ? concat({encoded, h}, 1) : h, Activation::relu);
  return h;
}

FieldOutput FrequencyField::operator()(const Tensor& points, const Tensor& directions, const Tensor& ray) const {
  const Tensor h = trunk(points);
  const Tensor seen = gather_rows(frequency_encoding(directions, options_.direction_frequencies), ray);
  const Tensor rgb = sigmoid(colour_(view_(concat({bottleneck_(h), seen}, 1), Activation::relu)));
  return {reshape(density_(h, Activation::relu), {points.dim(0)}), rgb};
}

Tensor FrequencyField::density(const Tensor& points) const {
  return reshape(density_(trunk(points), Activation::relu), {points.dim(0)});
}

int64_t FrequencyField::bytes_per_sample() const { return 4 * int64_t{options_.width} * (2 * options_.depth + 6); }

}  // namespace cloam
