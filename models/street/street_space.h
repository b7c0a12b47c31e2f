// A driving log as rays meet it: axes along the road, and the voxels in which a LiDAR saw something that does not move.
#pragma once
#include <array>

#include "models/batches/log_source.h"
#include "models/io/safetensors.h"
#include "runtime/ops.h"
#include "runtime/ops/street.h"

namespace cloam {

struct StreetSpaceOptions {
  float voxel = 0.5f;                                       // metres
  float along = 80, sideways = 60, below = 10, above = 30;  // metres around the sensors' track that count
  float sky = 3000;                                         // metres to the furthest sample
  int dilate = 1;                                           // voxels around occupied ones that count as well
};

/// Axes x along the road, z up; metres; the origin is the middle of the cameras' track.
class StreetSpace {
 public:
  /// The axes alone: every voxel counts as occupied until look() or restore().
  StreetSpace(const Scene& scene, const StreetSpaceOptions& options);
  /// Points of the sweeps within boxes of actors are left out. A
  /// wall that is seen up to the upper edge of the LiDAR's sight goes on above it: by a storey, and as far as training
  /// images look.
  void look(const Scene& scene, const std::vector<LoadedSweep>& sweeps);

  const Eigen::Matrix4d& street_from_world() const { return street_from_world_; }
  const StreetGrid& grid() const { return grid_; }
  /// Tensors "cells" (bits) and "numbers".
  TensorMap state() const;
  void restore(const TensorMap& state);

 private:
  struct Bounds {
    Eigen::Vector3d low, high;
  };
  Bounds reach() const;
  std::array<int, 3> counts() const;
  void lay(const Bounds& grid, const Bounds& middle);
  void mark(const std::vector<Eigen::Vector3d>& points);
  void raise(const std::vector<Eigen::Vector3d>& tops, const Scene& scene);
  void dilate();
  void upload();

  StreetSpaceOptions options_;
  Eigen::Matrix4d street_from_world_ = Eigen::Matrix4d::Identity();
  Bounds track_;                     // in street axes
  std::array<float, 16> numbers_{};  // StreetGrid::numbers
  std::vector<uint8_t> cells_;       // [D,H,W]
  StreetGrid grid_;
};

}  // namespace cloam
