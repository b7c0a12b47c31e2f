// A grid of decayed density maxima that tells marching where nothing is (Mueller et al. 2022, appendix C).
#pragma once
#include <Eigen/Geometry>
#include <functional>
#include <vector>

#include "models/io/safetensors.h"
#include "runtime/ops.h"

namespace cloam {

struct OccupancyOptions {
  int side = 128;
  int cells_per_update = 65536;
  float decay = 0.9f;
  float threshold = 1.f;  // density below which a cell counts as empty (never above the mean of all cells)
};

/// On the host: which cells of [0,1]^3 pictures take samples in. By default all.
class OccupiedCells {
 public:
  OccupiedCells() = default;
  OccupiedCells(const std::vector<float>& values, int side, float threshold);
  /// Densities [N] of points [N,3] in empty cells become 0.
  void clear_empty(const std::vector<float>& points, std::vector<float>& densities) const;
  bool none_in(const Eigen::AlignedBox3d& box) const;

 private:
  Eigen::Vector3i cell_at(const Eigen::Vector3d& point) const;
  bool at(int x, int y, int z) const;
  int side_ = 1;
  std::vector<bool> cells_ = {true};  // x innermost
};

class OccupancyGrid {
 public:
  explicit OccupancyGrid(const OccupancyOptions& options);
  /// [side^3] decayed maxima, and the value above which a cell counts as occupied.
  const Tensor& values() const { return values_; }
  float threshold() const { return threshold_; }
  using Density = std::function<Tensor(const Tensor& points)>;  // [S,3] in [0,1]^3 -> [S]
  /// The first time looks into all cells; then into the next ones of a fixed sweep that visits every cell once before
  /// any again. Until the first update everything counts as full.
  void update(const Density& density, const RandomKey& key);
  OccupiedCells occupied() const;
  /// Runs what update() runs, to no effect.
  void rehearse(const Density& density, const RandomKey& key);
  TensorMap state() const;
  void restore(const TensorMap& state);

 private:
  void visit_cells(const Density& density, const RandomKey& key);
  void refresh_threshold();
  OccupancyOptions options_;
  int64_t updates_ = 0;
  Tensor values_;
  float threshold_ = 0;
};

}  // namespace cloam
