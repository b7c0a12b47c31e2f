// How near renders come to photos, and what trivial guesses would score on the same photos.
#pragma once
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "models/data/load_images.h"
#include "models/train/method.h"

namespace cloam {

/// psnr, ssim: over the pixels that the mask keeps; psnr_full: over all.
struct ImageScore {
  std::string name;
  double psnr = 0, ssim = 0, psnr_full = 0;
};

/// Means of the images' values (NaN, an image that is masked out whole, is left out).
struct Evaluation {
  std::vector<ImageScore> images;
  double psnr = 0, ssim = 0, psnr_full = 0;
  bool masked = false;
  /// Every pixel the mean colour of the training photos.
  std::optional<double> baseline_mean_colour_psnr;
  /// A copy of the training photo of equal size whose camera is nearest in place and direction; none if no size fits.
  std::optional<double> baseline_nearest_frame_psnr;
};

/// One image as it is measured. truth, picture.rgb: [H,W,3].
struct EvaluatedImage {
  const ImageScore& score;
  const FramePixels& frame;
  const std::vector<float>& truth;
  const Picture& picture;
};

struct EvaluationData {
  const Scene& scene;  // of the measured photos
  const Pixels& photos;
  const Scene& train_scene;
  const Pixels& train;
};

/// Renders and measures every photo of data.photos; `seen` is called after each.
Evaluation evaluate(
    Method& method, const EvaluationData& data,
    const std::function<void(const EvaluatedImage&)>& seen = [](const EvaluatedImage&) {});

/// PSNR of one photo, over what its mask keeps, and over all pixels.
ImageScore score_image(const std::vector<float>& rgb, const std::vector<float>& truth, const FramePixels& frame);

}  // namespace cloam
