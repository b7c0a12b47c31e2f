// Cones of pixels, and samples of their pieces as isotropic Gaussians (Barron et al., Zip-NeRF, 2023, section 3;
// mip-NeRF 360, 2022, for the contraction).
#pragma once
#include "models/render/rays.h"

namespace cloam {

/// A pixel's cone of the same variance across as its square: the cone's radius at distance 1 over the pixel's width.
inline constexpr float kConeOfPixel = 0.57735027f;  // 2 / sqrt(12)

struct Cones {
  Rays rays;
  Tensor radii;  // [R] at distance 1
};

/// Isotropic Gaussians, K of each piece between two edges.
struct ConeSamples {
  Tensor points;  // [R,N,K,3]
  Tensor widths;  // [R,N,K] standard deviations
};

/// How the six samples of each piece are turned about the ray: by spin [R,N] of a whole turn, and the other way round
/// where flip [R,N] is 1.
struct ConeTurn {
  Tensor spin, flip;
};

/// Edges [R,N+1] ascending: six samples a piece, whose mean and variance along the ray are the frustum's, as is their
/// mean square distance from it. Differentiable in the rays.
ConeSamples six_samples(const Cones& cones, const Tensor& edges, const ConeTurn& turn);
/// The turn of pictures: every other piece by a twelfth, and the other way round.
ConeTurn still_turn(int64_t pieces);
/// One sample a piece: the frustum's mean, and its standard deviation across.
ConeSamples one_sample(const Cones& cones, const Tensor& edges);

/// What lies outside of the unit ball comes into the shell up to radius 2: x (2 - 1/|x|) / |x|. Gaussians shrink by the
/// cube root of the Jacobian's determinant.
ConeSamples contracted(const ConeSamples& samples);
/// Points [..,3] as contracted, back.
Tensor uncontracted(const Tensor& points);
/// To [0,1]^3: of the ball of radius 2 (contracted) or of [-1,1]^3, to which what lies beyond is clamped.
ConeSamples in_unit_cube(const ConeSamples& samples, bool is_contracted);

}  // namespace cloam
