// Batches of one whole photograph, for methods that draw whole pictures.
#pragma once
#include "models/io/share.h"
#include "models/scene/pixels.h"
#include "runtime/tensor.h"

namespace cloam {

struct Photograph {
  Tensor rgba, mask;  // u8 [4,H,W], [H,W] (empty: all used)
  Camera camera;
  Eigen::Matrix4d world_from_camera;
};

/// All training photographs on the device.
class PhotoSource {
 public:
  /// Fault::data for no image.
  PhotoSource(const Scene& scene, const Pixels& pixels);
  const std::vector<Photograph>& photographs() const { return photographs_; }
  /// The place of a step's photograph, steps counted from 1. Ranks take turns in one order: every photograph once
  /// before any comes again.
  size_t draw(uint64_t seed, int64_t step, const Share& share) const;

 private:
  std::vector<Photograph> photographs_;
};

}  // namespace cloam
