// Instant neural graphics primitives (Mueller et al. 2022): a hash grid, a density network and a colour network.
#pragma once
#include "models/fields/field.h"
#include "models/nn/layers.h"
#include "runtime/ops.h"
#include "runtime/ops/fields.h"

namespace cloam {

/// exp of the first feature less 3 (an untrained scene is nearly empty: surfaces must earn their density), its argument
/// kept where float32 and its gradient stay finite.
Tensor density_activation(const Tensor& feature);

/// Density network -> [S,16]; colour from those 16 and 16 spherical harmonics of the direction. Shared with the
/// tri-plane.
struct SplitNetwork {
  SplitNetwork(const Scope& scope, int64_t in, int64_t width);
  FieldOutput operator()(const Tensor& encoded, const Tensor& directions, const Tensor& ray) const;
  Tensor density(const Tensor& encoded) const;
  SmallMlp geometry, colour;
};

class HashField final : public Field {
 public:
  HashField(const Scope& scope, const FieldOptions& options);
  FieldOutput operator()(const Tensor& points, const Tensor& directions, const Tensor& ray) const override;
  Tensor density(const Tensor& points) const override;
  int64_t bytes_per_sample() const override { return 4 * (3 * 32 + 4 * width_ + 5 * 16); }

 private:
  int64_t width_;
  HashGridEncoder encoder_;
  Tensor table_;
  SplitNetwork network_;
};

}  // namespace cloam
