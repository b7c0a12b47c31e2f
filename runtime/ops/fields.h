// Parts of radiance fields: small networks, hash grids, tri-planes (ops/mlp.cpp, grid.cpp, planes.cpp).
#pragma once
#include "runtime/ops.h"

namespace cloam {

/// x [S,I] through weights[0] [I,W], ReLU, ... weights.back() [W,O] -> [S,O]; no biases. One fused kernel for
/// W in 16, 32 ... 128 and I, O up to 128 (once differentiable); mlp_composed is its reference and has all derivatives.
Tensor mlp(const Tensor& x, const Tensors& weights);
Tensor mlp_composed(const Tensor& x, const Tensors& weights);

/// Multiresolution hash grid (Mueller et al. 2022, section 3). Level l has floor(coarsest * b^l) cells an axis; the
/// last one has `finest`. Levels whose corners fit 2^log2_rows rows are dense, others hashed.
struct HashGrid {
  int levels = 8, features = 4, log2_rows = 16, coarsest = 16, finest = 1024;
};
Shape hash_grid_table_shape(const HashGrid& grid);  // [levels * 2^log2_rows, features]
class HashGridEncoder {
 public:
  explicit HashGridEncoder(const HashGrid& grid);
  /// points [S,3] in [0,1]^3, table as above -> [S, levels * features]; once differentiable in both.
  Tensor operator()(const Tensor& points, const Tensor& table) const;
  HashGrid grid;

 private:
  Tensor levels_;
};

/// Tri-plane features: planes [3,H,W,C] (xy, xz, yz), points [S,3] in [0,1]^3 -> [S,3C]; bilinear, half-pixel centres,
/// border padding; once differentiable in both.
Tensor sample_planes(const Tensor& planes, const Tensor& points);
/// The same for many: planes [3,A,H,W,C], owners [S] int32 in [0,A), whose planes each point reads.
Tensor sample_planes(const Tensor& planes, const Tensor& points, const Tensor& owners);

}  // namespace cloam
