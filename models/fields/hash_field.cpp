// Hash-grid field.
#include "models/fields/hash_field.h"

#include "runtime/ops/fields.h"
#include "runtime/ops/volume.h"

namespace cloam {

Tensor density_activation(const Tensor& feature) { return exp(clamp(feature - 3.f, -15.f, 15.f)); }

SplitNetwork::SplitNetwork(const Scope& scope, int64_t in, int64_t width)
    : geometry(scope / "geometry", {in, width, 16}), colour(scope / "colour", {32, width, width, 3}) {}

FieldOutput SplitNetwork::operator()(const Tensor& encoded, const Tensor& directions, const Tensor& ray) const {
  const Tensor features = geometry(encoded);
  const Tensor harmonics = gather_rows(spherical_harmonics(directions), ray);
  const Tensor rgb = sigmoid(colour(concat({features, harmonics}, 1)));
  return {density_activation(reshape(slice(features, 1, 0, 1), {features.dim(0)})), rgb};
}

Tensor SplitNetwork::density(const Tensor& encoded) const {
  const Tensor features = geometry(encoded);
  return density_activation(reshape(slice(features, 1, 0, 1), {features.dim(0)}));
}

HashField::HashField(const Scope& scope, const FieldOptions& o)
    : width_(o.width),
      encoder_(HashGrid{o.levels, o.features, o.log2_rows, o.coarsest, o.finest}),
      table_(scope.uniform("grid.table", hash_grid_table_shape(encoder_.grid), 1e-4f)),
      network_(scope, int64_t{o.levels} * o.features, o.width) {}

FieldOutput HashField::operator()(const Tensor& points, const Tensor& directions, const Tensor& ray) const {
  return network_(encoder_(points, table_), directions, ray);
}

Tensor HashField::density(const Tensor& points) const { return network_.density(encoder_(points, table_)); }

}  // namespace cloam
