// The field of streets.
#include "models/fields/street_field.h"

namespace cloam {
namespace {

constexpr float kNormalStep = 0.01f;  // metres

std::vector<int64_t> sizes(int64_t in, int layers, int64_t width, int64_t out) {
  std::vector<int64_t> all = {in};
  all.insert(all.end(), static_cast<size_t>(layers), width);
  all.push_back(out);
  return all;
}

}  // namespace

StreetField::StreetField(const Scope& scope, int64_t inputs, const StreetFieldOptions& o)
    : options_(o),
      distance_(scope / "distance", sizes(inputs, o.distance_layers, o.width, o.features)),
      feature_(scope / "feature", sizes(int64_t{o.features} + 16, o.feature_layers, o.width, o.features)),
      sharpness_(scope.constant("sharpness", {1}, o.sharpness)) {
  if (o.bypass) past_.emplace(scope / "past", inputs, o.features, 0.f);
}

StreetField::Geometry StreetField::geometry(const Tensor& encoded) const {
  const Tensor both = past_ ? distance_(encoded) + (*past_)(encoded) : distance_(encoded);
  return {reshape(slice(both, 1, 0, 1), {encoded.dim(0)}), both};
}

Tensor StreetField::features(const Tensor& inner, const Tensor& harmonics) const {
  const Tensor seen = feature_(concat({inner, harmonics}, 1));
  return options_.residual ? inner + seen : seen;
}

Tensor StreetField::opacity(const Tensor& distance) const { return sigmoid(-maximum(sharpness_, 1e-4f) * distance); }

Tensor outward_normals(const Tensor& points, const std::function<Tensor(const Tensor& points)>& distance) {
  Tensor outwards = zeros({points.dim(0), 3});
  for (const std::vector<float>& corner :
       std::vector<std::vector<float>>{{1, -1, -1}, {-1, -1, 1}, {-1, 1, -1}, {1, 1, 1}}) {
    const Tensor step = from_host(corner, {1, 3});
    outwards = outwards + step * unsqueeze(distance(points + step * kNormalStep), 1);
  }
  return outwards * rsqrt(sum(square(outwards), {{1}, true}) + 1e-12f);
}

}  // namespace cloam
