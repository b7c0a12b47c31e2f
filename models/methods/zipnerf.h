// Zip-NeRF (Barron et al. 2023): a grid-based radiance field that is sampled as wide as pixels see.
#pragma once
#include <algorithm>
#include <memory>

#include "models/batches/image_source.h"
#include "models/mesh/has_density.h"
#include "models/methods/camera_refinement.h"
#include "models/methods/zipnerf_renderer.h"
#include "models/train/learns_from_captures.h"
#include "models/train/method.h"
#include "models/train/refines_cameras.h"
#include "models/train/renders_views.h"

namespace cloam {

class ZipNerf final : public Method,
                      public LearnsFromCaptures,
                      public RendersViews,
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
  int64_t most_shares() const override { return std::min<int64_t>(kMostShares, config_.batch_rays); }
  Picture render(const View& view) override;
  DensityField density_field() const override { return renderer_->density_field(); }
  std::vector<Eigen::Matrix4d> refined_poses(int) const override { return cameras_.poses(); }
  std::vector<LensChange> lens_changes(int) const override { return cameras_.lens_changes(); }

 private:
  ZipNerfConfig config_;
  bool has_alpha_ = false;
  uint64_t seed_ = 0;
  Params params_;
  std::unique_ptr<ZipNerfRenderer> renderer_;
  std::unique_ptr<PixelSource> pixels_;
  CameraRefinement cameras_;
};

}  // namespace cloam
