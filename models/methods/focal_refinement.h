// Focal lengths as parameters (Wang et al. 2021, "NeRF--", section 3.2): each camera of a capture has one factor for
// all of its photos, whose logarithm begins as nothing and is learned with the scene. Directions become narrower or
// wider across the optical axis, so that a lens's distortion keeps its place in the photo (with_focal).
#pragma once
#include <string>

#include "models/nn/params.h"
#include "models/scene/scene.h"
#include "models/train/config.h"
#include "models/train/method.h"

namespace cloam {

struct FocalSettings {
  bool refine = false;
  float rate = 1e-3f;  // of logarithms
};
void bind_focals(Config& config, FocalSettings& settings);

class FocalRefinement {
 public:
  /// Of the scene's cameras; does nothing where they shall stay. The parameters outlive this; their names
  /// begin with `prefix`. Fault::usage for a lens whose picture is not that of a plane (fisheye, fov).
  void build(const FocalSettings& settings, const Scene& scene, Params& parameters, const std::string& prefix = "");
  bool on() const { return parameters_ != nullptr; }
  void add_group(ParameterGroups& groups) const;
  /// [C,1]: what x and y of directions (z = 1) are multiplied by. An empty handle when not on().
  Tensor narrowing() const;
  /// [3,1] of one camera: what the rows of a view_matrix() are multiplied by for the same pictures with the focal
  /// lengths given. An empty handle when not on().
  Tensor widening(int camera) const;
  /// How far focal lengths are from those given, in the mean: percent.
  std::vector<Figure> figures() const;
  /// As RefinesCameras has them.
  std::vector<double> factors() const;

 private:
  const Tensor& log_focals() const;

  FocalSettings settings_;
  std::string prefix_;
  const Params* parameters_ = nullptr;
};

}  // namespace cloam
