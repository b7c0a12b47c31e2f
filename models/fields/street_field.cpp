// The field of streets.
#include "models/fields/street_field.h"

namespace cloam {
namespace {

std::vector<int64_t> sizes(int64_t in, int layers, int64_t width, int64_t out) {
  std::vector<int64_t> all = {in};
  all.insert(all.end(), static_cast<size_t>(layers), width);
  all.push_back(out);
  return all;
}

}  // namespace

StreetField::StreetField(const Scope& scope, const StreetFieldOptions& o)
    : options_(o),
      distance_(scope / "distance", sizes(3 * int64_t{o.plane_channels}, o.distance_layers, o.width, o.features)),
      feature_(scope / "feature", sizes(int64_t{o.features} + 16, o.feature_layers, o.width, o.features)),
      sharpness_(scope.constant("sharpness", {1}, o.sharpness)) {
  if (o.bypass) past_.emplace(scope / "past", 3 * int64_t{o.plane_channels}, o.features, 0.f);
}

StreetField::Geometry StreetField::geometry(const Tensor& planes) const {
  const Tensor both = past_ ? distance_(planes) + (*past_)(planes) : distance_(planes);
  return {reshape(slice(both, 1, 0, 1), {planes.dim(0)}), both};
}

Tensor StreetField::features(const Tensor& inner, const Tensor& harmonics) const {
  const Tensor seen = feature_(concat({inner, harmonics}, 1));
  return options_.residual ? inner + seen : seen;
}

Tensor StreetField::opacity(const Tensor& distance) const { return sigmoid(-maximum(sharpness_, 1e-4f) * distance); }

}  // namespace cloam
