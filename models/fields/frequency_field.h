// The field of NeRF (Mildenhall et al. 2020, figure 7): frequency encoding and one deep network.
#pragma once
#include <vector>

#include "models/fields/field.h"
#include "models/nn/layers.h"

namespace cloam {

class FrequencyField final : public Field {
 public:
  FrequencyField(const Scope& scope, const FieldOptions& options);
  FieldOutput operator()(const Tensor& points, const Tensor& directions, const Tensor& ray) const override;
  Tensor density(const Tensor& points) const override;
  int64_t bytes_per_sample() const override;

 private:
  Tensor trunk(const Tensor& points) const;
  FieldOptions options_;
  std::vector<Linear> layers_;
  Linear density_, bottleneck_, view_, colour_;
};

}  // namespace cloam
