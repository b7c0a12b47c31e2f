// How near renders come to photos, and what trivial guesses would score on the same photos.
#pragma once
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "models/eval/actor_figures.h"
#include "models/eval/baselines.h"
#include "models/metrics/lpips.h"
#include "models/train/renders_views.h"

namespace cloam {

/// An actor that an image shows in fewer is left out where outlines are compared.
constexpr std::size_t kOutlinePixels = 100;

/// psnr, ssim: over the pixels that the photo's mask keeps; psnr_full: over all. masked_…: over the actors that have a
/// box at the photo's step, all together (ssim with both images black elsewhere); NaN where none is seen. moving_psnr:
/// over those of them that go somewhere in the log.
/// feature_distance: of a network, if one is given; of photo and render, and of both with all but the actors black.
/// lpips likewise, or its form with other weights than the published ones. overlap: of the outlines of actors that show
/// kOutlinePixels or more, intersection over union with the true masks; NaN without these. box_overlap: of the outlines
/// of the boxes.
struct ImageFigures {
  double psnr = kNoScore, ssim = kNoScore, psnr_full = kNoScore;
  double masked_psnr = kNoScore, masked_ssim = kNoScore, moving_psnr = kNoScore;
  double feature_distance = kNoScore, masked_feature_distance = kNoScore;
  double lpips = kNoScore, masked_lpips = kNoScore;
  double overlap = kNoScore, box_overlap = kNoScore;
  BaselineScores baselines = {};
};

struct ImageScore : ImageFigures {
  std::string name;
  std::optional<int> degrees = {};        // that rotate360 turned the actors by
  std::vector<ActorFigures> actors = {};  // of logs
};

/// The photos of one scene that are measured.
struct MeasuredScene {
  int index = 0;       // in the run
  const Scene& scene;  // of the photos
  const Pixels& photos;
  const Baselines& baselines;
  const ActorMasks* masks = nullptr;     // of logs
  const TrainingViews* views = nullptr;  // of logs; null: no actor has figures of its own
};

/// One image as it is measured. truth, picture.rgb: [H,W,3].
struct EvaluatedImage {
  const ImageScore& score;
  const FramePixels& frame;
  const std::vector<float>& truth;
  const Picture& picture;
  const ActorMask* actors = nullptr;  // of logs
};

struct EvaluateOptions {
  bool compare = true;  // false: the photos are no truth, and are only shown beside the renders
  const FeatureNetwork* features = nullptr;
  const Lpips* lpips = nullptr;
  std::function<void(const EvaluatedImage&)> seen = [](const EvaluatedImage&) {};  // called after each
};

/// The pixels that mask [H,W] is not 0 at, black elsewhere.
std::vector<float> on_black(const std::vector<float>& rgb, const std::vector<std::uint8_t>& mask);

/// Renders and measures one of the photos.
ImageScore evaluate_photo(RendersViews& method, const MeasuredScene& measured, std::size_t number,
                          const EvaluateOptions& options);
/// Renders and measures every photo.
std::vector<ImageScore> evaluate(RendersViews& method, const MeasuredScene& measured,
                                 const EvaluateOptions& options = {});

/// Figures are taken per image and then averaged, whatever the scene; images without one (NaN) are left out.
double mean_score(const std::vector<ImageScore>& images, const std::function<double(const ImageScore&)>& figure);

/// PSNR and SSIM of one photo, over what its mask keeps, and PSNR over all pixels.
ImageScore score_image(const std::vector<float>& rgb, const std::vector<float>& truth, const FramePixels& frame);

/// An image [H,W,3] as networks take it, [1,3,H,W].
Tensor as_batch(const std::vector<float>& rgb, int width, int height);

}  // namespace cloam
