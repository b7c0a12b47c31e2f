// Histograms along rays that propose where samples belong, and what holds them to what is rendered (Barron et al.,
// mip-NeRF 360, 2022, section 3; Zip-NeRF, 2023, section 4).
#pragma once
#include "models/render/rays.h"

namespace cloam {

/// Masses between ascending edges of [0,1], the rays' normalised distances. Nothing need sum to 1.
struct RayHistogram {
  Tensor edges;    // [R,N+1]
  Tensor weights;  // [R,N]
};

/// Zip-NeRF's ray warp: distances t to normalised ones and back, even in P(2 t, -1.5), P the power transformation
/// (eq. 23); or even in t. Shapes [R,..], broadcast with span's columns [R,1].
class RayWarp {
 public:
  /// span [R,2]; a ray that ends before it begins gets a short one.
  RayWarp(const Tensor& span, bool power);
  Tensor distances(const Tensor& normalised) const;
  Tensor normalised(const Tensor& distances) const;

 private:
  bool power_;
  Tensor near_, far_;  // [R,1] after the transformation
};

/// Edges [R,M+1] halfway between M > 1 samples of the histogram at ascending ranks [R,M] in [0,1), by its inverse CDF.
/// No gradient.
Tensor resampled_edges(const RayHistogram& histogram, const Tensor& ranks);

/// Between the edges `at` [R,P+1]: the mass of the histogram, spread evenly over 2 `half` around each place of it. No
/// gradient.
Tensor blurred_masses(const RayHistogram& histogram, const Tensor& at, float half);

/// Zip-NeRF's anti-aliased interlevel loss, a mean over rays and pieces: (what the blurred truth has above the
/// proposal)^2 over the proposal. The gradient goes to the proposal's weights.
Tensor interlevel_loss(const RayHistogram& truth, const RayHistogram& proposal, float half);

/// mip-NeRF 360's distortion loss (eq. 15), the mean over rays: sum of w_i w_j |m_i - m_j| + sum of w_i^2 d_i / 3. The
/// gradient goes to the weights.
Tensor distortion_loss(const RayHistogram& histogram);

}  // namespace cloam
