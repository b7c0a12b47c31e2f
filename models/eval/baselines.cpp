// See baselines.h.
#include "models/eval/baselines.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "models/eval/pictures.h"
#include "models/metrics/psnr.h"

namespace cloam {
namespace {

constexpr std::size_t kChannels = 3;
constexpr double kExact = 100;  // dB: only rounding differs

Eigen::Vector3d sight(const Frame& frame) { return frame.world_from_camera.block<3, 1>(0, 2); }

/// Mean colour of the photos, every pixel with the same weight.
std::vector<double> colour_of(const Pixels& train) {
  std::vector<double> colour(kChannels, 0);
  double count = 0;
  for (const FramePixels& frame : train.frames) {
    const std::vector<float> rgb = on_white(frame);
    for (std::size_t i = 0; i < rgb.size(); ++i) colour[i % kChannels] += static_cast<double>(rgb[i]);
    count += static_cast<double>(rgb.size() / kChannels);
  }
  for (double& channel : colour) channel /= count;
  return colour;
}

/// Mean colour of each row over the photos with so many rows.
std::vector<double> row_colours_of(const Pixels& train, int rows) {
  std::vector<double> colours(kChannels * static_cast<std::size_t>(rows), 0), counts(colours.size(), 0);
  for (const FramePixels& frame : train.frames) {
    if (frame.height != rows) continue;
    const std::vector<float> rgb = on_white(frame);
    const std::size_t row_values = kChannels * static_cast<std::size_t>(frame.width);
    for (std::size_t i = 0; i < rgb.size(); ++i) {
      const std::size_t at = i / row_values * kChannels + i % kChannels;
      colours[at] += static_cast<double>(rgb[i]);
      counts[at] += 1;
    }
  }
  for (std::size_t i = 0; i < colours.size(); ++i) colours[i] /= counts[i];
  return colours;
}

/// Of a picture: over the pixels of all actors, and of those that go somewhere; NaN where none is seen.
struct ActorScores {
  double all = kNoScore, moving = kNoScore;
};

ActorScores over_actors(const std::vector<float>& rgb, const MeasuredPhoto& photo) {
  if (!photo.actors) return {};
  return {masked_psnr(rgb, photo.rgb, photo.actors->any(), kChannels),
          masked_psnr(rgb, photo.rgb, photo.actors->moving(photo.scene), kChannels)};
}

/// Each actor in the mean colour that it has in the photo.
std::vector<float> painted(const MeasuredPhoto& photo) {
  const std::vector<int>& actors = photo.actors->actors;
  std::map<int, std::array<double, kChannels + 1>> sums;  // colour, pixels
  for (std::size_t i = 0; i < actors.size(); ++i) {
    auto& sum = sums[actors[i]];
    for (std::size_t c = 0; c < kChannels; ++c) sum[c] += static_cast<double>(photo.rgb[kChannels * i + c]);
    sum[kChannels] += 1;
  }
  std::vector<float> rgb(photo.rgb.size());
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    const auto& sum = sums.at(actors[i / kChannels]);
    rgb[i] = static_cast<float>(sum[i % kChannels] / sum[kChannels]);
  }
  return rgb;
}

std::vector<float> mean_of(const std::vector<float>& a, const std::vector<float>& b) {
  std::vector<float> mean(a.size());
  for (std::size_t i = 0; i < mean.size(); ++i) mean[i] = 0.5f * (a[i] + b[i]);
  return mean;
}

}  // namespace

double unless_exact(double psnr) { return psnr < kExact ? psnr : kNoScore; }

double psnr_of(const std::vector<float>& rgb, const std::vector<float>& truth, const FramePixels& frame) {
  return frame.mask.empty() ? psnr(rgb, truth) : masked_psnr(rgb, truth, frame.mask, kChannels);
}

Baselines::Baselines(const Scene& train_scene, const Pixels& train) : scene_(train_scene), train_(train) {
  if (train.frames.empty()) return;
  colour_ = colour_of(train);
  if (scene_.is_log) {
    rows_ = train.frames.front().height;
    row_colours_ = row_colours_of(train, rows_);
    return;
  }
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  const auto count = static_cast<double>(train.frames.size());
  for (const FramePixels& frame : train.frames) centre += scene_.frames[frame.frame].position() / count;
  for (const FramePixels& frame : train.frames)
    extent_ += (scene_.frames[frame.frame].position() - centre).norm() / count;
}

BaselineScores Baselines::score(const MeasuredPhoto& photo) const {
  BaselineScores scores;
  if (photo.actors) {
    const auto [all, moving] = over_actors(painted(photo), photo);
    scores.mean_masked = unless_exact(all), scores.mean_moving = unless_exact(moving);
  }
  if (colour_.empty()) return scores;
  std::vector<float> baseline(photo.rgb.size());
  for (std::size_t i = 0; i < baseline.size(); ++i) baseline[i] = static_cast<float>(colour_[i % kChannels]);
  scores.mean_colour = psnr_of(baseline, photo.rgb, photo.pixels);
  if (scene_.is_log) {
    score_log(photo, scores);
  } else if (const FramePixels* near = nearest_pose(photo)) {
    scores.nearest_frame = psnr_of(on_white(*near), photo.rgb, photo.pixels);
  }
  return scores;
}

void Baselines::score_log(const MeasuredPhoto& photo, BaselineScores& scores) const {
  if (photo.pixels.height == rows_) {
    std::vector<float> baseline(photo.rgb.size());
    const std::size_t row_values = kChannels * static_cast<std::size_t>(photo.pixels.width);
    for (std::size_t i = 0; i < baseline.size(); ++i)
      baseline[i] = static_cast<float>(row_colours_[i / row_values * kChannels + i % kChannels]);
    scores.row_mean = psnr_of(baseline, photo.rgb, photo.pixels);
  }
  const auto [before, after] = neighbours(photo);
  if (!before && !after) return;
  const auto step = [&](const FramePixels* pixels) { return scene_.frames[pixels->frame].step; };
  const int now = photo.scene.frames[photo.pixels.frame].step;
  const bool later = !before || (after && step(after) - now < now - step(before));
  const std::vector<float> copy = on_white(later ? *after : *before);
  const std::vector<float> blend = before && after ? mean_of(on_white(*before), on_white(*after)) : copy;
  scores.copy = psnr_of(copy, photo.rgb, photo.pixels);
  const ActorScores of_copy = over_actors(copy, photo), of_blend = over_actors(blend, photo);
  scores.copy_masked = of_copy.all, scores.copy_moving = of_copy.moving;
  scores.blend = psnr_of(blend, photo.rgb, photo.pixels);
  scores.blend_masked = of_blend.all, scores.blend_moving = of_blend.moving;
}

/// A photo is no guess for itself.
bool Baselines::fits(const MeasuredPhoto& photo, const FramePixels& other) const {
  const bool itself = photo.scene.root == scene_.root &&
                      photo.scene.frames[photo.pixels.frame].image == scene_.frames[other.frame].image;
  return !itself && photo.pixels.width == other.width && photo.pixels.height == other.height;
}

Baselines::Neighbours Baselines::neighbours(const MeasuredPhoto& photo) const {
  const Frame& frame = photo.scene.frames[photo.pixels.frame];
  const auto step = [&](const FramePixels* pixels) { return scene_.frames[pixels->frame].step; };
  Neighbours found;
  for (const FramePixels& other : train_.frames) {
    if (scene_.frames[other.frame].sensor != frame.sensor || !fits(photo, other)) continue;
    const bool earlier = step(&other) <= frame.step;
    const FramePixels*& best = earlier ? found.before : found.after;
    if (!best || (earlier ? step(&other) > step(best) : step(&other) < step(best))) best = &other;
  }
  return found;
}

/// The angle in radians plus the way in units of the cameras' mean distance from their centre.
const FramePixels* Baselines::nearest_pose(const MeasuredPhoto& photo) const {
  const Frame& frame = photo.scene.frames[photo.pixels.frame];
  const FramePixels* best = nullptr;
  double least = std::numeric_limits<double>::infinity();
  for (const FramePixels& other : train_.frames) {
    if (!fits(photo, other)) continue;
    const Frame& candidate = scene_.frames[other.frame];
    const double cosine = std::clamp(sight(frame).dot(sight(candidate)), -1.0, 1.0);
    const double distance =
        std::acos(cosine) + (frame.position() - candidate.position()).norm() / std::max(extent_, 1e-12);
    if (distance < least) best = &other;
    least = std::min(least, distance);
  }
  return best;
}

}  // namespace cloam
