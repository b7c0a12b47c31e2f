// 3D Gaussian Splatting (Kerbl et al. 2023, doi 10.1145/3592433): gaussians in space, projected, sorted and blended.
// Growth as in the paper or as Markov chain Monte Carlo (Kheradmand et al. 2024): models/splat/growth.h.
#pragma once
#include <memory>

#include "models/gaussians/exports_gaussians.h"
#include "models/methods/camera_refinement.h"
#include "models/methods/splat_renderer.h"
#include "models/splat/observed.h"
#include "models/splat/parameters.h"
#include "models/train/grows.h"
#include "models/train/learns_from_captures.h"
#include "models/train/method.h"
#include "models/train/refines_cameras.h"
#include "models/train/renders_views.h"

namespace cloam {

class Splat final : public Method,
                    public LearnsFromCaptures,
                    public RendersViews,
                    public Grows,
                    public RefinesCameras,
                    public ExportsGaussians {
 public:
  void configure(Config& config) override;
  void build(const Scenes& scenes, uint64_t seed) override;
  bool uses_depths() const override { return config_.depth > 0 || config_.initial == "depths"; }
  void load_data(std::vector<TrainingData> data) override;
  MemoryPlan memory(const PhotoSizes& photos) const override;
  Params& parameters() override { return params_; }
  ParameterGroups groups() const override;
  Step step(const Progress& progress, const Tensors& wanted) override;
  void after_step(const Progress&) override { observed_.take(); }
  RowMoves grow(const Progress& progress) override;
  Picture render(const View& view) override { return renderer_->picture(view); }
  Gaussians gaussians() const override { return gaussians_in(params_, common_); }
  GaussianDrawing drawing() const override { return renderer_->drawing(); }
  int64_t grows_until(const Progress& progress) const override { return growth_->until(progress); }
  void fit_to(const TensorMap& parameters) override;
  TensorMap state() const override { return observed_.state(); }
  void restore(const TensorMap& state) override { observed_.restore(state); }
  std::vector<Eigen::Matrix4d> refined_poses(int) const override { return cameras_.poses(); }
  std::vector<LensChange> lens_changes(int) const override { return cameras_.lens_changes(); }
  std::vector<std::string> warnings(const Scene& scene) const override;

 private:
  void put(const Gaussians& gaussians);

  SplatConfig config_;
  CameraRegion region_;
  bool grey_ = false;         // begun without colours: the photos have them
  bool from_depths_ = false;  // begun with one gaussian: the photos' depth maps have the others
  Gaussians common_;          // none: up and metric of all
  Params params_;
  std::unique_ptr<SplatRenderer> renderer_;
  std::unique_ptr<Growth> growth_;
  std::unique_ptr<PhotoSource> photos_;
  CameraRefinement cameras_;
  Observed observed_;
};

}  // namespace cloam
