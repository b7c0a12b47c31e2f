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
#include <string>

#include "models/nn/params.h"
#include "models/scene/scene.h"
#include "models/splat/draw.h"
#include "models/train/config.h"
#include "models/train/method.h"

namespace cloam {

struct PoseSettings {
  bool refine = false;
  float rate = 1e-3f, final_rate = 0.01f;  // the factor reached at the last step
  int warm_up = 200;                       // steps: at first a scene says nothing about poses
};

/// Of neurad and street-gaussians, whose steps see a few of hundreds of photos.
constexpr PoseSettings kPosesOfLogs = {.rate = 1e-2f};
void bind_poses(Config& config, PoseSettings& settings);

/// In scene units: of shifts, and how far away what the photos show is.
struct PoseScale {
  double unit, distance;
};
/// Of the same, metres: a calibration that is off by a degree is off by a decimetre rather than by what things are
/// away.
constexpr PoseScale kPoseScaleOfLogs = {.unit = 5, .distance = 15};

class PoseRefinement {
 public:
  /// Of the scene's training photos; does nothing where poses shall stay. The parameters outlive this; their names
  /// begin with `prefix`. Without a scale it is the distance to what the cameras look at.
  void build(const PoseSettings& settings, const Scene& scene, Params& parameters, const std::string& prefix = "",
             const std::optional<PoseScale>& scale = {});
  bool on() const { return parameters_ != nullptr; }
  void add_group(ParameterGroups& groups) const;
  /// [N,12], of all photos: rotations by rows, positions. scale: units of the positions in a scene unit.
  Tensor moved(const Tensor& poses, double scale) const;
  /// Of one photo; nothing when not on().
  ViewMove move_of(size_t photo) const;
  /// How far photos are from where they were given, in the mean: degrees, scene units.
  std::vector<Figure> figures() const;
  /// world_from_camera of all training photos; empty when not on().
  std::vector<Eigen::Matrix4d> poses() const;

 private:
  const Tensor& shifts() const;
  Tensor turns() const;

  PoseSettings settings_;
  std::string prefix_;
  std::vector<Eigen::Matrix4d> given_;
  PoseScale scale_ = {1, 1};
  const Params* parameters_ = nullptr;
};

}  // namespace cloam
