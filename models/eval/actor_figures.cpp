// See actor_figures.h.
#include "models/eval/actor_figures.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "models/io/in_parallel.h"
#include "models/metrics/psnr.h"

namespace cloam {
namespace {

constexpr int kMaskWidth = 320;  // of training photos: the outlines of boxes cost a ray a pixel and box

/// From the middle of the actor's box to the camera, in the axes of the box, of length 1. None where the actor has no
/// box at the frame's step.
std::optional<Eigen::Vector3d> seen_from(const Actor& actor, const Frame& frame) {
  const auto world_from_box = world_from_box_of_step(actor, frame.step, frame.timestamp);
  if (!world_from_box) return std::nullopt;
  const Eigen::Isometry3d pose(*world_from_box);
  return Eigen::Vector3d(pose.inverse() * frame.position()).normalized();
}

/// Pixels of each actor, by 1 + its place. each: pixels of the photo that one of the mask stands for.
std::map<int, int> pixels_of(const ActorMask& mask, int each = 1) {
  std::map<int, int> pixels;
  for (const int actor : mask.actors)
    if (actor != 0) pixels[actor] += each;
  std::erase_if(pixels, [](const auto& entry) { return entry.second < kShownPixels; });
  return pixels;
}

/// What a mean squared error needs, over the pixels of one actor.
struct PixelSums {
  double error = 0;  // squared, over the channels
  Eigen::Vector3d colour = Eigen::Vector3d::Zero(), squared = Eigen::Vector3d::Zero();

  void add(const Eigen::Vector3d& seen, const Eigen::Vector3d& truth) {
    error += (seen - truth).squaredNorm();
    colour += truth;
    squared += truth.cwiseAbs2();
  }
  double psnr(int pixels) const { return psnr_of_error(error / (3 * pixels)); }
  /// The squared error of the mean colour is the variance.
  double mean_psnr(int pixels) const {
    const double variance = squared.sum() - colour.squaredNorm() / pixels;
    return unless_exact(psnr_of_error(std::max(variance, 0.0) / (3 * pixels)));
  }
};

Eigen::Vector3d colour_at(const std::vector<float>& rgb, std::size_t pixel) {
  return Eigen::Map<const Eigen::Vector3f>(&rgb[3 * pixel]).cast<double>();
}

}  // namespace

TrainingViews::TrainingViews(const Scene& train_scene, const Pixels& train) {
  const ActorMasks masks(train_scene);
  std::vector<std::map<int, int>> shown(train.frames.size());
  in_parallel(shown.size(), [&](std::size_t i) {
    const FramePixels& photo = train.frames[i];
    const int factor = std::max(1, photo.width / kMaskWidth);
    const Camera camera = scaled(train.cameras[static_cast<std::size_t>(photo.camera)], factor);
    shown[i] = pixels_of(masks.of(train_scene.frames[photo.frame], camera), factor * factor);
  });
  for (std::size_t i = 0; i < shown.size(); ++i)
    for (const auto& [number, pixels] : shown[i]) {
      const Actor& actor = train_scene.actors[static_cast<std::size_t>(number) - 1];
      if (const auto direction = seen_from(actor, train_scene.frames[train.frames[i].frame]))
        directions_[actor.id].push_back(*direction);
    }
}

double TrainingViews::degrees_to_nearest(const Actor& actor, const Frame& frame) const {
  const auto direction = seen_from(actor, frame);
  const auto trained = directions_.find(actor.id);
  if (!direction || trained == directions_.end()) return kNoScore;
  double nearest = 2;  // length of the chord: exact where an angle's cosine is not
  for (const Eigen::Vector3d& other : trained->second) nearest = std::min(nearest, (other - *direction).norm());
  return 2 * std::asin(nearest / 2) * 180 / std::numbers::pi;
}

std::vector<ActorFigures> actor_figures(const std::vector<float>& picture, const MeasuredPhoto& photo,
                                        const TrainingViews& views) {
  const std::vector<int>& actors = photo.actors->actors;
  std::map<int, PixelSums> sums;
  for (std::size_t i = 0; i < actors.size(); ++i)
    if (actors[i] != 0) sums[actors[i]].add(colour_at(picture, i), colour_at(photo.rgb, i));
  std::vector<ActorFigures> figures;
  for (const auto& [number, pixels] : pixels_of(*photo.actors)) {
    const PixelSums& sum = sums.at(number);
    const Actor& actor = photo.scene.actors[static_cast<std::size_t>(number) - 1];
    figures.push_back({number - 1, pixels, sum.psnr(pixels), sum.mean_psnr(pixels),
                       views.degrees_to_nearest(actor, photo.scene.frames[photo.pixels.frame])});
  }
  return figures;
}

}  // namespace cloam
