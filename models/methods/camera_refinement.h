// What is learned of cameras with the scene: where photos were taken, and through which lenses.
#pragma once
#include "models/batches/image_source.h"
#include "models/batches/log_source.h"
#include "models/methods/lens_refinement.h"
#include "models/methods/pose_refinement.h"

namespace cloam {

struct CameraSettings {
  PoseSettings poses = {};
  LensSettings lenses = {};
};
/// Declares the settings.
void bind_cameras(Config& config, CameraSettings& settings);

class CameraRefinement {
 public:
  /// Of the scene's training photos and cameras: PoseRefinement::build and LensRefinement::build.
  void build(const CameraSettings& settings, const Scene& scene, Params& parameters, const std::string& prefix = "",
             const std::optional<PoseScale>& scale = {});
  bool on() const { return poses_.on() || lenses_.on(); }
  void add_groups(ParameterGroups& groups) const;
  /// As PixelSource::draw takes them. poses: its own, [N,12]; scale: units of them in a scene unit.
  LearnedCameras of_pixels(const Tensor& poses, double scale) const;
  /// Of one training photo, and its place among Scene::cameras.
  ViewMove move_of(std::size_t photo, int camera) const;
  std::vector<Figure> figures() const;
  /// As RefinesCameras has them.
  std::vector<Eigen::Matrix4d> poses() const { return poses_.poses(); }
  std::vector<LensChange> lens_changes() const { return lenses_.changes(); }

 private:
  PoseRefinement poses_;
  LensRefinement lenses_;
};

/// Rays of a list that are of one photo, one after the other.
struct RaysOfPhoto {
  std::size_t frame;  // place among Scene::frames
  int64_t count;
};
/// [R,3] each, axes of the log.
struct RaysInStreet {
  Tensor origins, directions;
};

/// The same of a driving log, whose rays are in lists. Of a rolling shutter each row's rays go with the pose of the
/// middle row; a learned lens bends them in its axes, too.
class LogCameras {
 public:
  /// log_from_world: to the axes of the rays.
  void build(const CameraSettings& settings, const Scene& scene, const Eigen::Matrix4d& log_from_world,
             Params& parameters, const std::string& prefix = "");
  /// What the log's photos and cameras learned.
  const CameraRefinement& learned() const { return learned_; }
  /// Those of photos, with which the list begins, as their cameras are learned to see; all others as they are.
  RaysInStreet moved(const RayList& rays, const std::vector<RaysOfPhoto>& photos) const;

 private:
  CameraRefinement learned_;
  Tensor given_;                               // [N,12] of the training photos, axes of the log
  std::vector<int32_t> photo_of_, camera_of_;  // of each frame: place among them, and among Scene::cameras
};

}  // namespace cloam
