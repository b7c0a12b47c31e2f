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

void put_gaussians(Params& parameters, const Gaussians& gaussians) {
  const auto count = static_cast<int64_t>(gaussians.count());
  for (const GaussianArray& array : kGaussianArrays)
    parameters[array.name] = parameter(gaussians.*array.values, shape_of(array, count));
}

void put_zeros(Params& parameters, int64_t count) {
  for (const GaussianArray& array : kGaussianArrays)
    parameters[array.name] =
        parameter(std::vector<float>(static_cast<size_t>(count) * array.width), shape_of(array, count));
}

int64_t gaussian_count(const Params& parameters) { return parameters.at("opacities").dim(0); }

Gaussians gaussians_in(const Params& parameters, const Gaussians& like) {
  Gaussians out = like;
  for (const GaussianArray& array : kGaussianArrays) out.*array.values = parameters.at(array.name).to_host();
  return out;
}

SplatModel splat_model(const Params& p, int degree) {
  return {{p.at("means"), p.at("scales"), p.at("rotations"), p.at("opacities")},
          {p.at("sh_first"), p.at("sh_rest"), degree}};
}

RowMoves row_moves(const GrowthMoves& moves) {
  RowMoves out;
  for (const GaussianArray& array : kGaussianArrays) out.push_back({array.name, moves.source});
  if (moves.opacities_reset)
    for (RowMove& move : out)
      if (move.name == "opacities") std::fill(move.source.begin(), move.source.end(), -1);
  return out;
}

}  // namespace cloam
