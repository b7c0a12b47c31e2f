// Gaussians as the parameters of a training: a tensor each for means, scales, rotations, opacities and colours.
#pragma once
#include "models/nn/params.h"
#include "models/splat/draw.h"
#include "models/splat/growth.h"
#include "models/train/grows.h"

namespace cloam {

/// In the place of those before.
void put_gaussians(Params& parameters, const Gaussians& gaussians);
/// So many, all numbers 0.
void put_zeros(Params& parameters, int64_t count);
int64_t gaussian_count(const Params& parameters);
/// `like` tells what they have in common: up and metric.
Gaussians gaussians_in(const Params& parameters, const Gaussians& like);
SplatModel splat_model(const Params& parameters, int degree);
/// Where the rows of every parameter came from.
RowMoves row_moves(const GrowthMoves& moves);

}  // namespace cloam
