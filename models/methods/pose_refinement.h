// Poses of training photos as parameters (Wang et al. 2021, "NeRF--", section 3.2; the camera optimiser of nerfstudio):
// each photo has a turn and a shift in its camera's axes (x right, y down, z forward), which begin as nothing and are
// learned with the scene.
//
// A little shift to the side and a little turn back show nearly the same picture. So that Adam, which looks at one
// number at a time, can tell them apart, a shift s comes with the turn (s_y, -s_x, 0) that keeps in place what the
// camera sees at distance 1 (preconditioning: Park et al. 2023, "CamP"); shifts are in units of the distance to what
// the cameras look at, or of less where they are surer than turns (PoseScale). A turn w [3] is the quaternion (1, w /
// 2), normalised: for small ones the angle |w| about w, and smooth at 0.
#pragma once
#include <optional>

#include "models/nn/params.h"
#include "models/scene/scene.h"
#include "models/train/config.h"
#include "models/train/method.h"

namespace cloam {

struct PoseSettings {
  bool refine = false;
  float rate = 1e-3f, final_rate = 0.01f;  // the factor reached at the last step
  int warm_up = 200;                       // steps: at first a scene says nothing about poses
};

/// Rays of photos in the axes of the scene.
struct PhotoRays {
  Tensor origins, directions;  // [R,3]
  Tensor photo;                // int32 [R]: place among the training photos
};

/// In scene units: of shifts, and how far away what the photos show is.
struct PoseScale {
  double unit, distance;
};

class PoseRefinement {
 public:
  /// Declares the settings.
  void configure(Config& config);
  /// Of the scene's training photos; does nothing where poses shall stay. The parameters outlive this.
  /// scale: the distance to what the cameras look at for both, where none is given.
  void build(const Scene& scene, Params& parameters, const std::optional<PoseScale>& scale = {});
  bool on() const { return parameters_ != nullptr; }
  void add_group(ParameterGroups& groups) const;
  /// [N,12], of all photos: rotations by rows, positions. scale: units of the positions in a scene unit.
  Tensor moved(const Tensor& poses, double scale) const;
  /// Rays of photos at `poses` [N,12] that moved: their cameras take them along.
  PhotoRays moved(const PhotoRays& rays, const Tensor& poses, double scale) const;
  /// [3,4] of view_matrix() of one photo.
  Tensor moved_view(const Tensor& view, size_t photo) const;
  /// How far photos are from where they were given, in the mean: degrees, scene units.
  std::vector<Figure> figures() const;
  /// world_from_camera of all training photos; empty when not on().
  std::vector<Eigen::Matrix4d> poses() const;

 private:
  Tensor turns() const;

  PoseSettings settings_;
  std::vector<Eigen::Matrix4d> given_;
  PoseScale scale_ = {1, 1};
  const Params* parameters_ = nullptr;
};

}  // namespace cloam
