// See encoded_field.h.
#include "models/fields/encoded_field.h"

#include "runtime/ops/fields.h"
#include "runtime/ops/sample.h"
#include "runtime/ops/volume.h"

namespace cloam {
namespace {

int64_t channels_of(const FieldOptions& o) {
  return o.kind == "hash" ? int64_t{o.levels} * o.features : 3 * int64_t{o.plane_channels};
}

std::function<Tensor(const Tensor&)> encoding_of(const Scope& scope, const FieldOptions& o) {
  if (o.kind == "hash") {
    const HashGridEncoder encoder(HashGrid{o.levels, o.features, o.log2_rows, o.coarsest, o.finest});
    const Tensor table = scope.uniform("grid.table", hash_grid_table_shape(encoder.grid), 1e-4f);
    return [=](const Tensor& points) { return encoder(points, table); };
  }
  const Tensor planes = scope.uniform("planes", {3, o.plane_side, o.plane_side, o.plane_channels}, 0.1f);
  return [=](const Tensor& points) { return sample_planes(planes, points); };
}

/// exp of the first feature less 3 (an untrained scene is nearly empty: surfaces must earn their density), its argument
/// kept where float32 and its gradient stay finite.
Tensor density_of(const Tensor& features) {
  return exp(clamp(reshape(slice(features, 1, 0, 1), {features.dim(0)}) - 3.f, -15.f, 15.f));
}

}  // namespace

EncodedField::EncodedField(const Scope& scope, const FieldOptions& o)
    : encoding_(encoding_of(scope, o)),
      bytes_(4 * ((o.kind == "hash" ? 3 * 32 : 2 * 3 * int64_t{o.plane_channels}) + 4 * int64_t{o.width} + 5 * 16)),
      geometry_(scope / "geometry", {channels_of(o), o.width, 16}),
      colour_(scope / "colour", {32, o.width, o.width, 3}) {}

FieldOutput EncodedField::operator()(const Tensor& points, const Tensor& directions, const Tensor& ray) const {
  const Tensor features = geometry_(encoding_(points));
  const Tensor harmonics = gather_rows(spherical_harmonics(directions), ray);
  return {density_of(features), sigmoid(colour_(concat({features, harmonics}, 1)))};
}

Tensor EncodedField::density(const Tensor& points) const { return density_of(geometry_(encoding_(points))); }

}  // namespace cloam
