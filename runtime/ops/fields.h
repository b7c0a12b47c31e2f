// Parts of radiance fields: small networks and hash grids (ops/mlp.cpp, grid.cpp, downweight.cpp).
#pragma once
#include "runtime/ops.h"

namespace cloam {

/// x [S,I] through weights[0] [I,W], ReLU, ... weights.back() [W,O] -> [S,O]; no biases. One fused kernel for
/// W in 16, 32 ... 128 and I, O up to 128; mlp_composed is its reference and gives the derivatives beyond the first.
Tensor mlp(const Tensor& x, const Tensors& weights);
Tensor mlp_composed(const Tensor& x, const Tensors& weights);

/// Multiresolution hash grid (Mueller et al. 2022, section 3). Level l has floor(coarsest * b^l) cells an axis; the
/// last one has `finest`. Levels whose corners fit 2^log2_rows rows are dense, others hashed.
struct HashGrid {
  int levels = 8, features = 4, log2_rows = 16, coarsest = 16, finest = 1024;
};
/// [levels * owners * 2^log2_rows, features]: by level, then by owner.
Shape hash_grid_table_shape(const HashGrid& grid, int64_t owners = 1);
class HashGridEncoder {
 public:
  explicit HashGridEncoder(const HashGrid& grid);
  /// points [S,3] in [0,1]^3, table as above -> [S, levels * features]. Many small grids lie in one table: owners int32
  /// [S] says whose rows each point reads. Any number of times differentiable in points and table.
  Tensor operator()(const Tensor& points, const Tensor& table, const Tensor& owners = {}) const;
  /// The same of general ops: its reference, and its derivatives beyond the first.
  Tensor composed(const Tensor& points, const Tensor& table, const Tensor& owners = {}) const;
  HashGrid grid;

 private:
  Tensor levels_;
};

/// Zip-NeRF's mean over the P places at which a wide sample reads a grid (Barron et al. 2023, section 2). features
/// [S*P, L*F] by place, widths [S,P] of the places in units of the grid, cells [L] an axis of each level -> [S, L*F]:
/// the mean of erf(1 / sqrt(8 (width cells)^2)) times the features. F is 1, 2 or 4. Differentiable in features alone.
Tensor downweighted_mean(const Tensor& features, const Tensor& widths, const Tensor& cells);
/// The same of general ops: its reference.
Tensor downweighted_mean_composed(const Tensor& features, const Tensor& widths, const Tensor& cells);

}  // namespace cloam
