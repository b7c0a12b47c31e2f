// Tri-plane field.
#include "models/fields/triplane_field.h"

#include "runtime/ops/sample.h"

namespace cloam {

TriplaneField::TriplaneField(const Scope& scope, const FieldOptions& o)
    : channels_(o.plane_channels),
      width_(o.width),
      planes_(scope.uniform("planes", {3, o.plane_side, o.plane_side, o.plane_channels}, 0.1f)),
      network_(scope, 3 * int64_t{o.plane_channels}, o.width) {}

FieldOutput TriplaneField::operator()(const Tensor& points, const Tensor& directions, const Tensor& ray) const {
  return network_(sample_planes(planes_, points), directions, ray);
}

Tensor TriplaneField::density(const Tensor& points) const { return network_.density(sample_planes(planes_, points)); }

}  // namespace cloam
