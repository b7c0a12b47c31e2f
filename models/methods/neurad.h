// NeuRAD (Tonderski et al., CVPR 2024): a driving log as one field of distances and features over hash grids, actors in
// their boxes, seen by cameras and LiDARs as they are. docs/methods/neurad.md has the whole.
#pragma once
#include <optional>

#include "models/methods/box_refinement.h"
#include "models/methods/camera_refinement.h"
#include "models/methods/neurad_model.h"
#include "models/nn/feature_network.h"
#include "models/street/missing_rays.h"
#include "models/street/refines_boxes.h"
#include "models/street/street.h"
#include "models/street/takes_edits.h"
#include "models/train/learns_from_captures.h"
#include "models/train/method.h"
#include "models/train/mixed_precision.h"
#include "models/train/refines_cameras.h"
#include "models/train/renders_views.h"
#include "models/train/takes_shapes.h"

namespace cloam {

struct NeuradConfig {
  NeuradOptions street;
  BoxSettings boxes;
  CameraSettings cameras{.poses = kPosesOfLogs};
  bool rolling_shutter = true;  // rows of photos are seen when they were exposed
  int patches = 40, patch_side = 32, lidar_rays = 16384;
  float weight_rgb = 5, weight_perceptual = 0.05f, weight_lidar = 0.01f, weight_line_of_sight = 0.01f;
  float weight_intensity = 0.1f, weight_drop = 0.01f;
  std::string perceptual_weights;  // file; empty: fixed random features
  float rate_grids = 1e-2f, rate_field = 1e-2f, rate_image = 1e-3f, rate_appearance = 1e-3f;
  float final_rate = 0.1f;
  int warm_up = 500, warm_up_image = 2500;  // steps
};

class Neurad final : public Method,
                     public LearnsFromCaptures,
                     public RendersViews,
                     public Street,
                     public HasSurfaces,
                     public TakesEdits,
                     public RefinesCameras,
                     public RefinesBoxes,
                     public TakesShapes,
                     public MixedPrecision {
 public:
  void configure(Config& config) override;
  void build(const Scenes& scenes, uint64_t seed) override;
  bool images_on_device() const override { return false; }
  void load_data(std::vector<TrainingData> data) override;
  MemoryPlan memory(const PhotoSizes& photos) const override;
  Params& parameters() override { return params_; }
  ParameterGroups groups() const override;
  Step step(const Progress& progress, const Tensors& wanted) override;
  int64_t most_shares() const override { return config_.patches; }
  void fit_to(const TensorMap& parameters) override { boxes_.fit_to(parameters); }
  TensorMap state() const override;
  void restore(const TensorMap& state) override;

  Picture render(const View& view) override;
  LidarReturns measure(const WorldRays& rays) override;
  Picture render_asset(const AssetName& asset, const Camera& camera, const Eigen::Matrix4d& box_from_camera) override;
  AssetSamples sample_asset(const AssetName& asset, const std::vector<float>& points) override;
  void take_actors(const Scenes& scenes) override;
  std::vector<Eigen::Matrix4d> refined_poses(int) const override { return cameras_.learned().poses(); }
  std::vector<LensChange> lens_changes(int) const override { return cameras_.learned().lens_changes(); }
  std::vector<Actor> refined_actors(int) const override { return boxes_.refined(model_->scene()->actors); }

 private:
  /// Announces what the steps after this one will read, so that it is decoded meanwhile.
  void look_ahead(const Progress& progress);
  /// What a step's rays are of: photos first, then the LiDAR's returns.
  struct Batch;
  void find_missing(const Scene& scene, const LogSweeps& sweeps);
  /// Rays of a sweep that sent nothing back.
  void add_missing(RayList& rays, HostRandom& random, const Share& share) const;
  Tensor returns_loss(const Batch& batch, const NeuradRays& seen, std::vector<Figure>& figures) const;
  Batch draw_batch(const Progress& progress) const;
  /// What rays meet, boxes where they were learned to be.
  NeuradScene street(const RayList& rays) const;
  /// The batch's rays as the cameras of its photos are learned to see.
  void move_rays(const Batch& batch, NeuradSampling& how) const;
  Tensor image_loss(const Batch& batch, const NeuradRays& seen, Tensor& squared) const;
  Tensor lidar_loss(const Batch& batch, const NeuradRays& seen, Tensor& metres) const;

  NeuradConfig config_;
  uint64_t seed_ = 0;
  Params params_;
  std::unique_ptr<NeuradModel> model_;
  std::unique_ptr<LogSource> data_;
  std::vector<WorldRays> missing_;  // of each sweep that has some
  int64_t missing_rays_ = 0;        // a step: as many to its returns as the sweeps have
  std::optional<FeatureNetwork> perceptual_;
  BoxRefinement boxes_;
  LogCameras cameras_;
  int64_t announced_ = 0;  // the last step that was
};

}  // namespace cloam
