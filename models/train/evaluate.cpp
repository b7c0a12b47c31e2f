// See evaluate.h. Photos and renders are compared as float [H,W,3] in [0,1]; nothing is rounded to 8 bits.
#include "models/train/evaluate.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "models/metrics/psnr.h"
#include "models/metrics/ssim.h"
#include "models/train/pictures.h"
#include "runtime/error.h"

namespace cloam {
namespace {

double psnr_of(const std::vector<float>& rgb, const std::vector<float>& truth, const FramePixels& frame) {
  return frame.mask.empty() ? psnr(rgb, truth) : masked_psnr(rgb, truth, frame.mask, 3);
}

template <class Value>
double mean_of(const std::vector<ImageScore>& images, Value value) {
  double sum = 0;
  int count = 0;
  for (const ImageScore& image : images) {
    if (std::isnan(value(image))) continue;
    sum += value(image);
    ++count;
  }
  return count > 0 ? sum / count : std::numeric_limits<double>::quiet_NaN();
}

struct Mean {
  double sum = 0;
  int count = 0;
  void add(double value) {
    if (std::isnan(value)) return;
    sum += value;
    ++count;
  }
  std::optional<double> value() const { return count > 0 ? std::optional(sum / count) : std::nullopt; }
};

/// Mean colour of the training photos, every pixel with the same weight.
std::vector<double> colour_of(const Pixels& train) {
  std::vector<double> colour(3, 0);
  double count = 0;
  for (const FramePixels& frame : train.frames) {
    const std::vector<float> rgb = on_white(frame);
    for (std::size_t i = 0; i < rgb.size(); ++i) colour[i % 3] += static_cast<double>(rgb[i]);
    count += static_cast<double>(rgb.size() / 3);
  }
  for (double& channel : colour) channel /= count;
  return colour;
}

class Baselines {
 public:
  explicit Baselines(const EvaluationData& data) : data_(data) {
    if (!data.train.frames.empty()) colour_ = colour_of(data.train);
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    const auto count = static_cast<double>(std::max<std::size_t>(1, data.train.frames.size()));
    for (const FramePixels& frame : data.train.frames) centre += place(data.train_scene, frame) / count;
    for (const FramePixels& frame : data.train.frames) {
      extent_ += (place(data.train_scene, frame) - centre).norm() / count;
    }
  }

  void add(const FramePixels& frame, const std::vector<float>& truth) {
    if (colour_.empty()) return;
    std::vector<float> guess(truth.size());
    for (std::size_t i = 0; i < guess.size(); ++i) guess[i] = static_cast<float>(colour_[i % 3]);
    mean_colour.add(psnr_of(guess, truth, frame));
    if (const FramePixels* near = nearest(frame)) nearest_frame.add(psnr_of(on_white(*near), truth, frame));
  }

  Mean mean_colour, nearest_frame;

 private:
  static Eigen::Vector3d place(const Scene& scene, const FramePixels& frame) {
    return scene.frames[frame.frame].world_from_camera.block<3, 1>(0, 3);
  }
  static Eigen::Vector3d sight(const Scene& scene, const FramePixels& frame) {
    return scene.frames[frame.frame].world_from_camera.block<3, 1>(0, 2);
  }

  /// The angle in radians plus the way in units of the cameras' mean distance from their centre. A photo is no
  /// baseline for itself.
  double distance(const FramePixels& frame, const FramePixels& other) const {
    const double cosine = sight(data_.scene, frame).dot(sight(data_.train_scene, other));
    const double way = (place(data_.scene, frame) - place(data_.train_scene, other)).norm();
    return std::acos(std::clamp(cosine, -1.0, 1.0)) + way / std::max(extent_, 1e-12);
  }

  bool is_candidate(const FramePixels& frame, const FramePixels& other) const {
    const bool itself =
        &frame == &other || (data_.scene.root == data_.train_scene.root &&
                             data_.scene.frames[frame.frame].image == data_.train_scene.frames[other.frame].image);
    return !itself && frame.width == other.width && frame.height == other.height;
  }

  const FramePixels* nearest(const FramePixels& frame) const {
    const FramePixels* best = nullptr;
    double least = std::numeric_limits<double>::infinity();
    for (const FramePixels& other : data_.train.frames) {
      const double candidate = is_candidate(frame, other) ? distance(frame, other) : least;
      if (candidate < least) best = &other;
      least = std::min(least, candidate);
    }
    return best;
  }

  const EvaluationData& data_;
  std::vector<double> colour_;
  double extent_ = 0;
};

}  // namespace

ImageScore score_image(const std::vector<float>& rgb, const std::vector<float>& truth, const FramePixels& frame) {
  const ImageShape shape{frame.height, frame.width, 3};
  ImageScore score;
  score.psnr = psnr_of(rgb, truth, frame);
  score.psnr_full = psnr(rgb, truth);
  score.ssim = frame.mask.empty() ? ssim(rgb, truth, shape) : masked_ssim(rgb, truth, frame.mask, shape);
  return score;
}

Evaluation evaluate(Method& method, const EvaluationData& data,
                    const std::function<void(const EvaluatedImage&)>& seen) {
  Evaluation result;
  Baselines baselines(data);
  for (const FramePixels& frame : data.photos.frames) {
    const Frame& source = data.scene.frames[frame.frame];
    const Camera& camera = data.photos.cameras[static_cast<std::size_t>(frame.camera)];
    const Picture picture = method.render(view_of(source, camera, 0));
    const std::vector<float> truth = on_white(frame);
    ImageScore score = score_image(picture.rgb, truth, frame);
    score.name = source.image;
    baselines.add(frame, truth);
    result.masked = result.masked || !frame.mask.empty();
    result.images.push_back(score);
    seen({result.images.back(), frame, truth, picture});
  }
  result.psnr = mean_of(result.images, [](const ImageScore& i) { return i.psnr; });
  result.psnr_full = mean_of(result.images, [](const ImageScore& i) { return i.psnr_full; });
  result.ssim = mean_of(result.images, [](const ImageScore& i) { return i.ssim; });
  result.baseline_mean_colour_psnr = baselines.mean_colour.value();
  result.baseline_nearest_frame_psnr = baselines.nearest_frame.value();
  return result;
}

}  // namespace cloam
