// Focal lengths and principal points as parameters: each camera of a capture has one factor for all of its photos,
// whose logarithm begins as nothing and is learned with the scene (Wang et al. 2021, "NeRF--", section 3.2), and a
// shift of its principal point in focal lengths given. Directions become narrower or wider across the optical axis, so
// that a lens's distortion keeps its place in the photo (with_lens).
#pragma once
#include <string>
#include <vector>

#include "models/nn/params.h"
#include "models/scene/camera.h"
#include "models/scene/learned_lenses.h"
#include "models/scene/scene.h"
#include "models/train/config.h"
#include "models/train/method.h"

namespace cloam {

struct LensSettings {
  bool refine = false, centres = false;  // focal lengths, principal points
  float rate = 1e-3f;                    // of logarithms and of focal lengths
};
void bind_lenses(Config& config, LensSettings& settings);

class LensRefinement {
 public:
  /// Of the scene's cameras; does nothing where they shall stay. The parameters outlive this; their names
  /// begin with `prefix`. Fault::usage for a lens whose picture is not that of a plane (fisheye, fov), and for
  /// principal points of any lens but a pinhole, which would take its distortion along.
  void build(const LensSettings& settings, const Scene& scene, Params& parameters, const std::string& prefix = "");
  bool on() const { return parameters_ != nullptr; }
  void add_group(ParameterGroups& groups) const;
  /// Of all cameras. Empty handles for what is not learned.
  LearnedLenses lenses() const;
  /// Of one: [1,1] and [1,2].
  LearnedLenses lens(int camera) const;
  /// How far lenses are from those given, in the mean: focal lengths in percent, principal points in percent of the
  /// focal length.
  std::vector<Figure> figures() const;
  /// As RefinesCameras has them.
  std::vector<LensChange> changes() const;

 private:
  LensSettings settings_;
  std::string prefix_;
  const Params* parameters_ = nullptr;
};

}  // namespace cloam
