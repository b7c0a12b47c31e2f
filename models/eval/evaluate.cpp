// See evaluate.h. Photos and renders are compared as float [H,W,3] in [0,1]; nothing is rounded to 8 bits.
#include "models/eval/evaluate.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "models/eval/pictures.h"
#include "models/metrics/feature_distance.h"
#include "models/metrics/overlap.h"
#include "models/metrics/psnr.h"
#include "models/metrics/ssim.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

void score_actors(ImageScore& score, const Picture& picture, const MeasuredPhoto& photo) {
  const std::vector<std::uint8_t> mask = photo.actors->any();
  score.masked_psnr = masked_psnr(picture.rgb, photo.rgb, mask, 3);
  score.moving_psnr = masked_psnr(picture.rgb, photo.rgb, photo.actors->moving(photo.scene), 3);
  score.masked_ssim = masked_ssim(picture.rgb, photo.rgb, mask, {photo.pixels.height, photo.pixels.width, 3});
}

/// Outlines of boxes are no truth.
void score_outlines(ImageScore& score, const Picture& picture, const ActorMask& truth, const MeasuredScene& measured,
                    const FramePixels& pixels) {
  const Frame& frame = measured.scene.frames[pixels.frame];
  if (picture.actors.empty() || !measured.masks->has_truth(frame)) return;
  const Camera& camera = measured.photos.cameras[static_cast<std::size_t>(pixels.camera)];
  const ActorMask boxes = ActorMasks(measured.scene, false).of(frame, camera);
  score.overlap = mean_overlap(picture.actors, truth.actors, kOutlinePixels);
  score.box_overlap = mean_overlap(boxes.actors, truth.actors, kOutlinePixels);
}

/// A distance by a network, of photo and render and of both with all but the actors black.
struct Distances {
  double whole = kNoScore, actors = kNoScore;
};

template <class Distance>
Distances distances_of(const Distance& by, int64_t smallest, const Picture& picture, const MeasuredPhoto& photo) {
  const int w = photo.pixels.width, h = photo.pixels.height;
  if (std::min(w, h) < smallest) return {};
  const auto distance = [&](const std::vector<float>& a, const std::vector<float>& b) {
    return static_cast<double>(by(as_batch(a, w, h), as_batch(b, w, h)).item());
  };
  Distances found{distance(picture.rgb, photo.rgb)};
  if (!photo.actors) return found;
  const std::vector<std::uint8_t> mask = photo.actors->any();
  const bool seen = std::any_of(mask.begin(), mask.end(), [](std::uint8_t actor) { return actor != 0; });
  if (seen) found.actors = distance(on_black(picture.rgb, mask), on_black(photo.rgb, mask));
  return found;
}

void score_networks(ImageScore& score, const EvaluateOptions& options, const Picture& picture,
                    const MeasuredPhoto& photo) {
  if (options.features) {
    const auto by = [&](const Tensor& a, const Tensor& b) { return feature_distance(*options.features, a, b); };
    const Distances found = distances_of(by, options.features->smallest, picture, photo);
    score.feature_distance = found.whole, score.masked_feature_distance = found.actors;
  }
  if (options.lpips) {
    const Distances found = distances_of(*options.lpips, options.lpips->network.smallest, picture, photo);
    score.lpips = found.whole, score.masked_lpips = found.actors;
  }
}

ImageScore score_photo(const Picture& picture, const MeasuredPhoto& photo, const Baselines& baselines,
                       const EvaluateOptions& options) {
  ImageScore score = score_image(picture.rgb, photo.rgb, photo.pixels);
  score.baselines = baselines.score(photo);
  if (photo.actors) score_actors(score, picture, photo);
  score_networks(score, options, picture, photo);
  return score;
}

}  // namespace

std::vector<float> on_black(const std::vector<float>& rgb, const std::vector<std::uint8_t>& mask) {
  std::vector<float> out(rgb);
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = mask[i / 3] != 0 ? out[i] : 0.f;
  return out;
}

ImageScore score_image(const std::vector<float>& rgb, const std::vector<float>& truth, const FramePixels& frame) {
  const ImageShape shape{frame.height, frame.width, 3};
  ImageScore score;
  score.psnr = psnr_of(rgb, truth, frame);
  score.psnr_full = psnr(rgb, truth);
  score.ssim = frame.mask.empty() ? ssim(rgb, truth, shape) : masked_ssim(rgb, truth, frame.mask, shape);
  return score;
}

ImageScore evaluate_photo(RendersViews& method, const MeasuredScene& measured, std::size_t number,
                          const EvaluateOptions& options) {
  const FramePixels& pixels = measured.photos.frames.at(number);
  const Frame& frame = measured.scene.frames[pixels.frame];
  const Camera& camera = measured.photos.cameras[static_cast<std::size_t>(pixels.camera)];
  const Picture picture = method.render(view_of(frame, camera, measured.index));
  const std::vector<float> truth = on_white(pixels);
  const auto mask = measured.masks ? std::optional(measured.masks->of(frame, camera)) : std::nullopt;
  const MeasuredPhoto photo{measured.scene, pixels, truth, mask ? &*mask : nullptr};
  ImageScore score = options.compare ? score_photo(picture, photo, measured.baselines, options) : ImageScore{};
  score.name = frame.image;
  if (options.compare && mask) score_outlines(score, picture, *mask, measured, pixels);
  if (options.compare && mask && measured.views) score.actors = actor_figures(picture.rgb, photo, *measured.views);
  options.seen({score, pixels, truth, picture, photo.actors});
  return score;
}

std::vector<ImageScore> evaluate(RendersViews& method, const MeasuredScene& measured, const EvaluateOptions& options) {
  std::vector<ImageScore> scores;
  for (std::size_t i = 0; i < measured.photos.frames.size(); ++i)
    scores.push_back(evaluate_photo(method, measured, i, options));
  return scores;
}

double mean_score(const std::vector<ImageScore>& images, const std::function<double(const ImageScore&)>& figure) {
  double sum = 0;
  int count = 0;
  for (const ImageScore& image : images) {
    if (std::isnan(figure(image))) continue;
    sum += figure(image);
    ++count;
  }
  return count > 0 ? sum / count : kNoScore;
}

Tensor as_batch(const std::vector<float>& rgb, int width, int height) {
  std::vector<float> planes(rgb.size());
  const std::size_t count = rgb.size() / 3;
  for (std::size_t i = 0; i < rgb.size(); ++i) planes[i % 3 * count + i / 3] = rgb[i];
  return from_host(planes, {1, 3, height, width});
}

}  // namespace cloam
