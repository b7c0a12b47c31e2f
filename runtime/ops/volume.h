// Where rays through a volume have samples: marching, importance sampling, occupancy (ops/volume.cpp).
#pragma once
#include "runtime/ops.h"

namespace cloam {

struct Rays {
  Tensor origins, directions;  // [R,3]; directions of length 1
  Tensor span;                 // [R,2]: near and far distance
};
struct MarchOptions {
  int side = 128;         // occupancy cells an axis
  bool contract = false;  // the unbounded scene folded into [-2,2]^3, else [-1,1]^3 as it is
  int capacity = 1024;    // samples a ray keeps at most
  float min_step = 0.01f, max_step = 1e9f, cone = 0.f;  // dt = clamp(t * cone, min_step, max_step)
  float threshold = 0.f;                                // cells above it are stepped through
  int explore = 0;  // not 0: one empty cell in 64, chosen by this number, is stepped through as well
};
/// Samples of all rays side by side; ray r owns [offsets[r], offsets[r+1]).
struct RaySamples {
  Tensor points;   // [S,3] in [0,1]^3
  Tensor t, dt;    // [S] middle and length of the interval
  Tensor ray;      // [S] int32
  Tensor offsets;  // [R+1] int32
};
/// Stratified steps through the occupied cells. jitter [R] in [0,1) shifts each ray; cells [side^3]: optical thickness
/// of one smallest step. Runs at once (the number of samples is known only then); nothing is differentiable.
RaySamples march(const Rays& rays, const Tensor& jitter, const Tensor& cells, const MarchOptions& options);
/// The samples of each ray up to where its transmittance falls below `least`. Runs at once.
RaySamples visible(const RaySamples& samples, const Tensor& sigma, float least);

/// NeRF's inverse-CDF sampling: edges [R,n+1], weights [R,n], ascending uniform [R,m] -> merged edges [R,n+1+m]; no
/// gradient.
Tensor importance_edges(const Tensor& edges, const Tensor& weights, const Tensor& uniform);
/// Scene points [S,3] to [0,1]^3, contracted or not (MarchOptions::contract).
Tensor unit_points(const Tensor& points, bool contract);
/// Real spherical harmonics of degree 4 of unit directions [S,3] -> [S,16]; no gradient.
Tensor spherical_harmonics(const Tensor& directions);

/// Cells start, start + stride ... of a grid of side^3 (stride prime to side^3), with a jittered point [n,3] in each.
struct OccupancyCells {
  Tensor cells, points;
};
OccupancyCells occupancy_cells(const Tensor& jitter, int side, int64_t start, int64_t stride);
/// values [side^3] at the cells become max(decay * value, density), in place.
void occupancy_merge(Tensor& values, const Tensor& cells, const Tensor& density, float decay);

}  // namespace cloam
