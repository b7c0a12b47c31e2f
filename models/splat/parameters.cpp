// See parameters.h.
#include "models/splat/parameters.h"

namespace cloam {
namespace {

/// One of the parameters: name, shape after G, and where a file keeps it.
struct Part {
  const char* name;
  Shape after;
  std::vector<float> Gaussians::*values;
  Tensor of(const std::vector<float>& all, int64_t count) const {
    Shape shape = {count};
    for (const int64_t size : after) shape.push_back(size);
    return parameter(all, shape);
  }
};
const Part kParts[] = {{"means", {3}, &Gaussians::means},         {"scales", {3}, &Gaussians::scales},
                       {"rotations", {4}, &Gaussians::rotations}, {"opacities", {}, &Gaussians::opacities},
                       {"sh_first", {3}, &Gaussians::sh_first},   {"sh_rest", {15, 3}, &Gaussians::sh_rest}};

}  // namespace

void put_gaussians(Params& parameters, const Gaussians& gaussians) {
  const auto count = static_cast<int64_t>(gaussians.count());
  for (const Part& part : kParts) parameters[part.name] = part.of(gaussians.*part.values, count);
}

void put_zeros(Params& parameters, int64_t count) {
  for (const Part& part : kParts) {
    const int64_t numbers = count * numel(part.after);
    parameters[part.name] = part.of(std::vector<float>(static_cast<size_t>(numbers)), count);
  }
}

int64_t gaussian_count(const Params& parameters) { return parameters.at("opacities").dim(0); }

Gaussians gaussians_in(const Params& parameters, const Gaussians& like) {
  Gaussians out;
  for (const Part& part : kParts) out.*part.values = parameters.at(part.name).to_host();
  out.up = like.up;
  out.metric = like.metric;
  return out;
}

SplatModel splat_model(const Params& p, int degree) {
  return {{p.at("means"), p.at("scales"), p.at("rotations"), p.at("opacities")},
          {p.at("sh_first"), p.at("sh_rest"), degree}};
}

RowMoves row_moves(const GrowthMoves& moves) {
  RowMoves out;
  for (const Part& part : kParts) out.push_back({part.name, moves.source});
  if (moves.opacities_reset)
    for (RowMove& move : out)
      if (move.name == "opacities") std::fill(move.source.begin(), move.source.end(), -1);
  return out;
}

}  // namespace cloam
