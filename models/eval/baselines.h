// What trivial guesses score on the photos that a method is measured on: a figure that does not clear them is no
// result. They are made from the training photos alone, but for the masks' mean colours, which know the truth.
#pragma once
#include <limits>
#include <optional>
#include <vector>

#include "models/data/actor_masks.h"
#include "models/scene/pixels.h"

namespace cloam {

constexpr double kNoScore = std::numeric_limits<double>::quiet_NaN();
/// Masks of a pixel or two, or of one colour, show nothing but rounding beside a guess (100 dB): NaN, nothing was
/// guessed.
double unless_exact(double psnr);

/// PSNR of each guess; NaN where it cannot be made.
struct BaselineScores {
  double mean_colour = kNoScore;    // every pixel the mean colour of the training photos
  double nearest_frame = kNoScore;  // a copy of the training photo nearest in place and direction
  // Of logs. "masked": over the pixels of actors; "moving": of those that go somewhere.
  // The nearest training photo of the same camera, the earlier of two.
  double copy = kNoScore, copy_masked = kNoScore, copy_moving = kNoScore;
  // The mean of its nearest training photos before and after.
  double blend = kNoScore, blend_masked = kNoScore, blend_moving = kNoScore;
  double mean_masked = kNoScore, mean_moving = kNoScore;  // each actor in the mean colour that it has in the photo
  double row_mean = kNoScore;                             // each row the mean colour that it has in the training photos
};

/// One photo that is measured; actors: where they are seen, null where that is not known.
struct MeasuredPhoto {
  const Scene& scene;
  const FramePixels& pixels;
  const std::vector<float>& rgb;  // [H,W,3]
  const ActorMask* actors = nullptr;
};

/// The guesses of one scene.
class Baselines {
 public:
  Baselines(const Scene& train_scene, const Pixels& train);
  BaselineScores score(const MeasuredPhoto& photo) const;

 private:
  struct Neighbours {
    const FramePixels *before = nullptr, *after = nullptr;
  };
  void score_log(const MeasuredPhoto& photo, BaselineScores& scores) const;
  Neighbours neighbours(const MeasuredPhoto& photo) const;
  const FramePixels* nearest_pose(const MeasuredPhoto& photo) const;
  bool fits(const MeasuredPhoto& photo, const FramePixels& other) const;

  const Scene& scene_;
  const Pixels& train_;
  std::vector<double> colour_;  // empty: there are no training photos
  int rows_ = 0;
  std::vector<double> row_colours_;  // [rows_,3], of the photos with so many rows
  double extent_ = 0;
};

/// Over what the photo's own mask keeps.
double psnr_of(const std::vector<float>& rgb, const std::vector<float>& truth, const FramePixels& frame);

}  // namespace cloam
