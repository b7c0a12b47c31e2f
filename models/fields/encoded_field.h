// Fields of a learned encoding of points and two small networks: a hash grid (Mueller et al. 2022), or three planes
// (EG3D, Chan et al. 2022: xy, xz, yz; features concatenated as SSDNeRF does).
#pragma once
#include <functional>

#include "models/fields/field.h"
#include "models/nn/layers.h"

namespace cloam {

class EncodedField final : public Field {
 public:
  /// options.kind: hash or triplane.
  EncodedField(const Scope& scope, const FieldOptions& options);
  FieldOutput operator()(const Tensor& points, const Tensor& directions, const Tensor& ray) const override;
  Tensor density(const Tensor& points) const override;
  int64_t bytes_per_sample() const override { return bytes_; }

 private:
  std::function<Tensor(const Tensor& points)> encoding_;
  int64_t bytes_;
  SmallMlp geometry_;  // to 16 features, of which the first is the density's
  SmallMlp colour_;    // of those and 16 spherical harmonics of the direction
};

}  // namespace cloam
