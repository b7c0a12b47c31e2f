// What a batch of rendered pixels is compared with.
#pragma once
#include "models/batches/image_source.h"

namespace cloam {

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

}  // namespace cloam
