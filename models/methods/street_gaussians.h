// Street Gaussians (Yan et al., ECCV 2024): a driving log as gaussians, those of the background in the world, those of
// rigid actors in the axes of their boxes, drawn together in one pass before a sky.
#pragma once
#include "models/batches/image_source.h"
#include "models/gaussians/adopts_actors.h"
#include "models/gaussians/exports_actors.h"
#include "models/methods/street_gaussians_losses.h"
#include "models/methods/street_gaussians_model.h"
#include "models/splat/observed.h"
#include "models/splat/parameters.h"
#include "models/street/photo_hints.h"
#include "models/street/refines_boxes.h"
#include "models/street/takes_edits.h"
#include "models/train/grows.h"
#include "models/train/learns_from_captures.h"
#include "models/train/method.h"
#include "models/train/refines_cameras.h"
#include "models/train/renders_views.h"

namespace cloam {

class StreetGaussians final : public Method,
                              public LearnsFromCaptures,
                              public RendersViews,
                              public Street,
                              public TakesEdits,
                              public ExportsActors,
                              public AdoptsActors,
                              public RefinesBoxes,
                              public RefinesCameras,
                              public Grows {
 public:
  void configure(Config& config) override;
  void build(const Scenes& scenes, uint64_t seed) override;
  void load_data(std::vector<TrainingData> data) override;
  MemoryPlan memory(const PhotoSizes& photos) const override;
  Params& parameters() override { return params_; }
  ParameterGroups groups() const override;
  Step step(const Progress& progress, const Tensors& wanted) override;
  void after_step(const Progress&) override { observed_.take(); }
  RowMoves grow(const Progress& progress) override;
  int64_t grows_until(const Progress& progress) const override { return background_growth_->until(progress); }
  void fit_to(const TensorMap& parameters) override;
  TensorMap state() const override;
  void restore(const TensorMap& state) override;

  Picture render(const View& view) override;
  LidarReturns measure(const WorldRays& rays) override;
  Picture render_asset(const AssetName& asset, const Camera& camera, const Eigen::Matrix4d& box_from_camera) override;
  Gaussians background_gaussians() const override { return gaussians_in(params_, common_, kBackgroundPart); }
  Gaussians actor_gaussians(const AssetName& asset) const override;
  void adopt(std::size_t place, const Gaussians& looks) override;
  std::vector<Eigen::Matrix4d> refined_poses(int) const override { return cameras_.poses(); }
  std::vector<LensChange> lens_changes(int) const override { return cameras_.lens_changes(); }
  std::vector<Actor> refined_actors(int) const override { return model_->boxes().refined(model_->actors()); }
  void take_actors(const Scenes& scenes) override { model_->take_actors(scenes.at(0).actors); }

 private:
  void begin(const Scene& scene, const LogSweeps& sweeps, const Pixels& pixels);
  void add_hints(const Scene& scene, const StreetSpace& space, const LogSweeps& sweeps, const Pixels& pixels);
  std::vector<bool> flips(const Progress& progress) const;
  int64_t count() const { return model_->count(kBackgroundPart) + model_->count(kActorsPart); }
  RowMoves grow_background(const GrowthStatistics& statistics, const Progress& progress);
  RowMoves grow_actors(const GrowthStatistics& statistics, const Progress& progress);
  void shift(Growth& growth, const char* part, const Progress& progress);

  StreetGaussiansConfig config_;
  uint64_t seed_ = 0;
  CameraRegion region_;
  Gaussians common_;  // none: up and metric of all
  Params params_;
  std::unique_ptr<StreetGaussiansModel> model_;
  std::unique_ptr<Growth> background_growth_, actors_growth_;
  std::unique_ptr<PhotoSource> photos_;
  CameraRefinement cameras_;
  std::vector<PhotoHints> hints_;
  std::vector<BoxesInPhoto> boxes_;  // of the photos that train
  Observed observed_;                // of all gaussians, actors' last
};

}  // namespace cloam
