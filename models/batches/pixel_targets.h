// What a batch of rendered pixels is compared with.
#pragma once
#include "models/batches/image_source.h"

namespace cloam {

/// What the settings train.loss and background can be.
inline const std::vector<std::string> kPixelLosses = {"square", "charbonnier"},
                                      kBackgrounds = {"auto", "white", "random", "none"};

struct BackgroundKind {
  std::string kind;     // auto, white, random or none
  bool is_random_auto;  // what auto is: random colours, or none
};
/// [R,3] of the share's rays, or [1,3]: what is seen where nothing is. Random colours in training teach a field to be
/// opaque or empty.
Tensor background_of(const BackgroundKind& which, int64_t rays, const RandomKey& key, const Share& share);

/// [R,3]: the photos' colours, over the background where the capture has alpha.
Tensor truth_over(const Tensor& background, const PixelBatch& batch, bool has_alpha);

/// The mean of the squared error, or of Charbonnier's (kind: charbonnier). used [R] 0 or 1, or an empty handle.
Tensor pixel_loss(const std::string& kind, const Tensor& rendered, const Tensor& truth, const Tensor& used);

/// How far lengths are from what depth maps say: |t - d| / (t + d), from 0 to 1; 0 where d is not known (0). Shapes as
/// they broadcast.
Tensor depth_errors(const Tensor& lengths, const Tensor& depths);

/// Samples along rays, of shapes that broadcast with each other.
struct DepthSamples {
  Tensor lengths, weights;  // along the ray; of what is seen, as composite_weights
  Tensor depths;            // of their rays, as PixelBatch has them
};
/// The mean over rays of how far light must be moved to come from the depth that a sensor saw, by depth_errors (the
/// earth mover's distance); light that comes from nowhere is as far as can be. Like DS-NeRF's loss (Deng et al. 2022)
/// and that of URF (Rematas et al. 2022) on lines of sight, it leaves nothing before a surface. Rays without a depth
/// add nothing. depths: of each ray, once.
Tensor depth_loss(const DepthSamples& samples, const Tensor& depths);

}  // namespace cloam
