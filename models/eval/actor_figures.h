// Actors one by one in the images that are measured, and how far from every training view each is seen.
#pragma once
#include <map>
#include <string>
#include <vector>

#include "models/eval/baselines.h"

namespace cloam {

/// An actor that an image shows in fewer is left out.
constexpr int kShownPixels = 16;

/// One actor in one image. psnr: over its pixels; mean_psnr: where they have its true mean colour, NaN where they have
/// one colour anyway. view_degrees: between the direction that the camera sees the actor from, in the axes of its box,
/// and the nearest such direction of a training photo that shows it; NaN where none does.
struct ActorFigures {
  int actor = 0;  // place in Scene::actors
  int pixels = 0;
  double psnr = kNoScore, mean_psnr = kNoScore, view_degrees = kNoScore;
};

/// The directions that the training photos of a log see each actor from.
class TrainingViews {
 public:
  TrainingViews() = default;
  /// What a photo shows is asked of masks of 320 to 639 pixels a row. Fault::data for truth/ that is damaged.
  TrainingViews(const Scene& train_scene, const Pixels& train);
  /// Actors are those of the same id, whatever looks an edit has given them. As ActorFigures::view_degrees has it.
  double degrees_to_nearest(const Actor& actor, const Frame& frame) const;

 private:
  std::map<std::string, std::vector<Eigen::Vector3d>> directions_;  // by the actor's id, of length 1
};

/// Of the actors that the photo shows, by their places in the scene. picture: the render of it, [H,W,3].
std::vector<ActorFigures> actor_figures(const std::vector<float>& picture, const MeasuredPhoto& photo,
                                        const TrainingViews& views);

}  // namespace cloam
