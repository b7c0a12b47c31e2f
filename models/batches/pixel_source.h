// Batches of pixels: some of all training images of a capture, as rays in normalised scene coordinates.
#pragma once
#include "models/io/share.h"
#include "models/render/rays.h"
#include "models/scene/pixels.h"

namespace cloam {

struct PixelBatch {
  Rays rays;
  Tensor rgba;  // [R,4] in [0,1], straight alpha
  Tensor used;  // [R] 1, or 0 where a mask says ignore; empty when there are no masks
};

/// All training pixels on the device.
class PixelSource {
 public:
  /// Fault::data for no image, Fault::memory for more than 2^29 pixels.
  PixelSource(const Scene& scene, const Pixels& pixels, const SceneFrame& frame, const RayRange& range);
  /// The share of `count` pixels at random: a frame, then a pixel in it. streams key.stream and the one after it.
  PixelBatch draw(int64_t count, const RandomKey& key, const Share& share) const;

 private:
  SceneFrame frame_;
  RayRange range_;
  Tensor rgba_, mask_;  // [P,4], [P] uint8
  Tensor directions_;   // [D,3] of length 1, camera axes
  Tensor poses_;        // [N,12] rotation by rows, position (normalised)
  Tensor frames_;       // [N,3] int32: first pixel, pixels, first direction
};

}  // namespace cloam
