// Rays of cameras in normalised scene coordinates, and the bank of training pixels that batches are drawn from.
#pragma once
#include "models/render/scene_frame.h"
#include "models/scene/pixels.h"
#include "models/scene/view.h"
#include "runtime/ops.h"
#include "runtime/ops/volume.h"

namespace cloam {

/// How far rays reach: through the box [-1,1]^3, or from `near` to `far` in a contracted scene.
struct RayRange {
  float near = 0.05f, far = 64.f;
};

/// Every pixel of a view, row-major [H*W]. Lengths along rays are in normalised units.
Rays view_rays(const View& view, const SceneFrame& frame, const RayRange& range);

struct RayBatch {
  Rays rays;
  Tensor rgba;  // [R,4] in [0,1], straight alpha
  Tensor used;  // [R] 1, or 0 where a mask says ignore; empty when there are no masks
};

/// All training pixels on the device.
class RayBank {
 public:
  RayBank(const Scene& scene, const Pixels& pixels, const SceneFrame& frame, const RayRange& range);
  /// `count` pixels at random: a frame, then a pixel in it. streams key.stream and the one after it.
  RayBatch sample(int64_t count, const RandomKey& key) const;

 private:
  SceneFrame frame_;
  RayRange range_;
  Tensor rgba_, mask_;  // [P,4], [P] uint8
  Tensor directions_;   // [D,3] of length 1, camera axes
  Tensor poses_;        // [N,12] rotation by rows, position (normalised)
  Tensor frames_;       // [N,3] int32: first pixel, pixels, first direction
  int64_t frame_count_;
};

}  // namespace cloam
