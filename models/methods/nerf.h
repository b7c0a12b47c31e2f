// NeRF (Mildenhall et al. 2020) and its fast descendants: one method, its parts chosen by settings.
// Preset nerf: hash grid, occupancy grid, marching (Mueller et al. 2022). Preset nerf-paper: frequency encoding, 8x256,
// 64 stratified and 128 importance samples, two networks.
#pragma once
#include <algorithm>
#include <memory>

#include "models/batches/image_source.h"
#include "models/mesh/has_density.h"
#include "models/methods/camera_refinement.h"
#include "models/methods/nerf_renderer.h"
#include "models/train/learns_from_captures.h"
#include "models/train/method.h"
#include "models/train/refines_cameras.h"
#include "models/train/renders_views.h"
#include "models/train/shows_samples.h"

namespace cloam {

class Nerf final : public Method,
                   public LearnsFromCaptures,
                   public RendersViews,
                   public ShowsSamples,
                   public HasDensity,
                   public RefinesCameras {
 public:
  void configure(Config& config) override;
  void build(const Scenes& scenes, uint64_t seed) override;
  bool uses_depths() const override { return config_.depth > 0; }
  void load_data(std::vector<TrainingData> data) override;
  MemoryPlan memory(const PhotoSizes& photos) const override;
  Params& parameters() override { return params_; }
  ParameterGroups groups() const override;
  Step step(const Progress& progress, const Tensors& wanted) override;
  int64_t most_shares() const override { return std::min<int64_t>(kLeastRays, config_.batch_rays); }
  void after_step(const Progress& progress) override;
  Picture render(const View& view) override;
  std::vector<RaySample> samples(const View& view, int row) override;
  DensityField density_field() const override { return renderer_->density_field(); }
  std::vector<Eigen::Matrix4d> refined_poses(int) const override { return cameras_.poses(); }
  std::vector<LensChange> lens_changes(int) const override { return cameras_.lens_changes(); }
  TensorMap state() const override;
  void restore(const TensorMap& state) override;

 private:
  static constexpr int64_t kLeastRays = 64;  // a step
  NerfConfig config_;
  bool has_alpha_ = false;
  uint64_t seed_ = 0;
  Params params_;
  std::unique_ptr<NerfRenderer> renderer_;
  std::unique_ptr<PixelSource> pixels_;
  CameraRefinement cameras_;
  int64_t rays_ = 0;                  // of the next step: follows the samples a ray costs
  double samples_ = 0, marched_ = 0;  // of the last step, shaded and marched to
  bool skimmed_ = false;              // it left out the dark ones
  int64_t lit_permille_ = 1000;       // of the samples marched to, those that get light
};

}  // namespace cloam
