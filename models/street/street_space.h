// A driving log as rays meet it: axes along the road, and the voxels in which a LiDAR saw something that does not move.
#pragma once
#include <array>
#include <functional>
#include <span>

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

/// The voxels of a space on the host, as StreetGrid has them on the device.
struct StreetCells {
  std::array<int, 3> counts, block_counts;  // x y z
  std::vector<uint8_t> cells, blocks;       // [D,H,W]
};

/// Points [N,3] in a grid's axes in the coordinates of a background, [N,3] in [0,1]^3: contracted() of
/// kernels/street.cl.
Tensor contracted(const Tensor& points, const StreetGrid& grid);

/// Takes a sweep of a log.
using SweepVisitor = std::function<void(const Sweep& sweep, const LidarPoints& points)>;

/// Axes x along the road, z up; metres; the origin is the middle of the cameras' track.
class StreetSpace {
 public:
  /// The axes alone: every voxel counts as occupied until look() or restore().
  StreetSpace(const Scene& scene, const StreetSpaceOptions& options);
  /// Points of the sweeps within boxes of actors are left out. A wall that is seen up to the upper edge of the LiDAR's
  /// sight goes on above it: by a storey, and as far as training images look. Touches no device.
  /// with_sweep(number, visit): visits that sweep; several threads call it at once.
  void look(const Scene& scene, std::size_t sweeps,
            const std::function<void(std::size_t number, const SweepVisitor& visit)>& with_sweep);
  void look(const Scene& scene, const std::vector<LoadedSweep>& sweeps);

  const StreetSpaceOptions& options() const { return options_; }
  const Eigen::Matrix4d& street_from_world() const { return street_from_world_; }
  /// On the device from the first call on, until rest(). What is kept of the voxels meanwhile are packed bits: of a
  /// hundred logs, a step sees one.
  const StreetGrid& grid() const;
  /// Touches no device, for threads that unpack ahead of use.
  StreetCells unpacked() const;
  uint64_t unpacked_bytes() const;
  /// grid(), of voxels that are unpacked already.
  void show(const StreetCells& cells) const;
  bool is_shown() const { return bool(grid_.cells); }
  void rest() const { grid_ = {}; }

  /// What look() found, and the same from bytes. False for bytes that are of no space.
  std::vector<uint8_t> kept() const;
  bool take(std::span<const uint8_t> bytes);
  /// Tensors "cells" (bits) and "numbers".
  TensorMap state() const;
  void restore(const TensorMap& state);

 private:
  struct Bounds {
    Eigen::Vector3d low, high;
  };
  Bounds reach() const;
  std::array<int, 3> counts() const;
  std::size_t cell_count() const;
  std::vector<uint8_t> bits() const;
  void pack();
  void lay(const Bounds& grid, const Bounds& middle);
  void mark(const std::vector<Eigen::Vector3d>& points);
  void raise(const std::vector<Eigen::Vector3d>& tops, const Scene& scene);
  void dilate();

  StreetSpaceOptions options_;
  Eigen::Matrix4d street_from_world_ = Eigen::Matrix4d::Identity();
  Bounds track_;                     // in street axes
  std::array<float, 16> numbers_{};  // StreetGrid::numbers
  std::vector<uint8_t> cells_;       // [D,H,W], while look() is at work
  std::vector<uint8_t> packed_;      // gzip of bits, eight cells a byte; empty: every cell is occupied
  mutable StreetGrid grid_;          // empty: not on the device
};

}  // namespace cloam
