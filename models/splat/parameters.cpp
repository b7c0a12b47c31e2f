// See parameters.h.
#include "models/splat/parameters.h"

namespace cloam {
namespace {

Shape shape_of(const GaussianArray& array, int64_t count) {
  if (array.width == 1) return {count};
  const auto width = static_cast<int64_t>(array.width);
  return array.width == 3 * kSphericalRest ? Shape{count, kSphericalRest, 3} : Shape{count, width};
}

}  // namespace

void put_gaussians(Params& parameters, const Gaussians& gaussians, const std::string& prefix) {
  const auto count = static_cast<int64_t>(gaussians.count());
  for (const GaussianArray& array : kGaussianArrays)
    parameters[prefix + array.name] = parameter(gaussians.*array.values, shape_of(array, count));
}

void put_zeros(Params& parameters, int64_t count, const std::string& prefix) {
  for (const GaussianArray& array : kGaussianArrays)
    parameters[prefix + array.name] =
        parameter(std::vector<float>(static_cast<size_t>(count) * array.width), shape_of(array, count));
}

int64_t gaussian_count(const Params& parameters, const std::string& prefix) {
  return parameters.at(prefix + "opacities").dim(0);
}

Gaussians gaussians_in(const Params& parameters, const Gaussians& like, const std::string& prefix) {
  Gaussians out = like;
  for (const GaussianArray& array : kGaussianArrays) out.*array.values = parameters.at(prefix + array.name).to_host();
  return out;
}

SplatModel splat_model(const Params& parameters, int degree, const std::string& prefix) {
  const auto at = [&](const char* name) { return parameters.at(prefix + name); };
  return {{at("means"), at("scales"), at("rotations"), at("opacities")}, {at("sh_first"), at("sh_rest"), degree}};
}

RowMoves row_moves(const GrowthMoves& moves, const std::string& prefix) {
  RowMoves out;
  for (const GaussianArray& array : kGaussianArrays) out.push_back({prefix + array.name, moves.source});
  if (moves.opacities_reset)
    for (RowMove& move : out)
      if (move.name == prefix + "opacities") std::fill(move.source.begin(), move.source.end(), -1);
  return out;
}

}  // namespace cloam
