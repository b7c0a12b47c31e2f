// 3D Gaussian Splatting (Kerbl et al. 2023, doi 10.1145/3592433): gaussians in space, projected, sorted and blended.
// Growth as in the paper or as Markov chain Monte Carlo (Kheradmand et al. 2024): models/splat/growth.h.
#pragma once
#include <memory>

#include "models/gaussians/exports_gaussians.h"
#include "models/splat/draw.h"
#include "models/splat/growth.h"
#include "models/train/grows.h"
#include "models/train/learns_from_captures.h"
#include "models/train/method.h"
#include "models/train/renders_views.h"
#include "runtime/ops.h"

namespace cloam {

struct SplatConfig {
  std::string initial = "auto";     // auto | points | lidar | random
  int initial_random = 20000;       // gaussians
  std::string background = "auto";  // auto | black | white | random
  bool antialiased = false;
  float near = 0.01f;  // of the scene's extent
  int sh_degree = 3;
  int sh_every = 1000;         // steps between degrees, at most
  float ssim = 0.2f;           // weight; 1 - ssim is that of the absolute difference
  float rate_means = 1.6e-4f;  // times the extent
  float final_means = 0.01f;   // factor reached at the horizon
  float rate_first = 2.5e-3f, rate_rest = 1.25e-4f, rate_opacities = 0.05f, rate_scales = 5e-3f, rate_rotations = 1e-3f;
  bool exposure = false;        // a gain and an offset for each channel of each training image, their means 1 and 0
  float rate_exposure = 0.01f;  // falls to a tenth
  GrowthOptions growth;
};

class Splat final : public Method,
                    public LearnsFromCaptures,
                    public RendersViews,
                    public Grows,
                    public ExportsGaussians {
 public:
  void configure(Config& config) override;
  void build(const Scenes& scenes, uint64_t seed) override;
  void load_data(std::vector<TrainingData> data) override;
  MemoryPlan memory(const PhotoSizes& photos) const override;
  Params& parameters() override { return params_; }
  ParameterGroups groups() const override;
  Step step(const Progress& progress, const Tensors& wanted) override;
  RowMoves grow(const Progress& progress) override;
  Picture render(const View& view) override;
  Gaussians gaussians() const override;
  int64_t grows_until(const Progress& progress) const override { return growth_->until(progress); }
  void fit_to(const TensorMap& parameters) override;
  TensorMap state() const override;
  void restore(const TensorMap& state) override;
  std::vector<std::string> warnings(const Scene& scene) const override;

 private:
  struct Photograph {
    Tensor rgba, mask;  // u8 [4,H,W], [H,W] (empty: all used)
    Camera camera;
    Eigen::Matrix4d world_from_camera;
  };
  void put(const Gaussians& gaussians);
  void take_colours(const Pixels& pixels);
  SplatModel model(int degree) const;
  int64_t count() const { return params_.at("opacities").dim(0); }
  DrawOptions draw_options() const;
  int degree_at(const Progress& progress) const;
  size_t photograph_for(const Progress& progress) const;
  Tensor background_for(const Progress& progress) const;
  Tensor exposed(const Tensor& planes, size_t photograph) const;
  Tensor loss(const Progress& progress);
  void observe();

  SplatConfig config_;
  uint64_t seed_ = 0;
  CameraRegion cameras_;
  bool grey_ = false;  // begun without colours: the photos have them
  Eigen::Vector3d up_ = Eigen::Vector3d::UnitZ();
  bool has_alpha_ = false, metric_ = false;
  Params params_;
  std::unique_ptr<Growth> growth_;
  std::vector<Photograph> photographs_;
  int64_t frames_ = 0;  // that train, of the scene
  int degree_ = 0;      // reached
  Drawn last_;          // of this step
  Tensor probe_, mean_gradient_, error_;
  Tensor gradient_sums_, views_;  // [G] since the last growth
};

}  // namespace cloam
