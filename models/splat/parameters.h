// Gaussians as the parameters of a training: a tensor each for means, scales, rotations, opacities and colours.
#pragma once
#include "models/nn/params.h"
#include "models/splat/draw.h"
#include "models/splat/growth.h"
#include "models/train/grows.h"

namespace cloam {

// The names of a part's parameters begin with its prefix, "actors."; those of a method without parts have none.

constexpr uint64_t kGaussianBytes = 4 * 59;  // of one's parameters

/// In the place of those before.
void put_gaussians(Params& parameters, const Gaussians& gaussians, const std::string& prefix = "");
/// So many, all numbers 0.
void put_zeros(Params& parameters, int64_t count, const std::string& prefix = "");
int64_t gaussian_count(const Params& parameters, const std::string& prefix = "");
/// `like` tells what they have in common: up and metric.
Gaussians gaussians_in(const Params& parameters, const Gaussians& like, const std::string& prefix = "");
SplatModel splat_model(const Params& parameters, int degree, const std::string& prefix = "");
/// Where the rows of every parameter came from.
RowMoves row_moves(const GrowthMoves& moves, const std::string& prefix = "");

}  // namespace cloam
