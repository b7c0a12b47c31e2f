// NeRF (Mildenhall et al. 2020) and its fast descendants: one method, its parts chosen by settings.
// Preset nerf: hash grid, occupancy grid, marching (Mueller et al. 2022). Preset nerf-paper: frequency encoding, 8x256,
// 64 stratified and 128 importance samples, two networks.
#pragma once
#include <memory>

#include "models/fields/field.h"
#include "models/render/occupancy.h"
#include "models/render/rays.h"
#include "models/train/learns_from_captures.h"
#include "models/train/method.h"
#include "models/train/renders_views.h"
#include "runtime/ops/volume.h"

namespace cloam {

struct NerfConfig {
  FieldOptions field;
  OccupancyOptions occupancy;
  std::string sampling = "occupancy";  // occupancy | importance
  std::string background = "auto";     // auto | white | random | none
  int batch_rays = 1024;               // importance: rays a step; occupancy: at most 16 times as many
  int batch_samples = 65536;           // occupancy: samples a step aims at
  int coarse_samples = 64, fine_samples = 128;
  float min_step = 0.f;                             // in normalised units; 0: chosen by the kind of scene
  float cone = 0.03f;                               // unbounded scenes: step length over distance
  float learning_rate = 1e-2f, final_rate = 0.03f;  // factor reached at the horizon
  float decay_start = 0.3f;                         // share of the horizon before the rate falls
  int decay_steps = 0;          // not 0: the rate reaches final_rate after so many steps, whatever the horizon
  float distortion = 0.005f;    // mip-NeRF 360: draws each ray's weights together
  std::string loss = "square";  // square | charbonnier
  int occupancy_every = 16, occupancy_start = 64;
};

class Nerf final : public Method, public LearnsFromCaptures, public RendersViews {
 public:
  void configure(Config& config) override;
  void build(const Scenes& scenes, uint64_t seed) override;
  void load_data(std::vector<TrainingData> data) override;
  MemoryPlan memory(const PhotoSizes& photos) const override;
  Params& parameters() override { return params_; }
  ParameterGroups groups() const override;
  Step step(const Progress& progress, const Tensors& wanted) override;
  void after_step(const Progress& progress) override;
  Picture render(const View& view) override;
  TensorMap state() const override;
  void restore(const TensorMap& state) override;

 private:
  struct Rendered {
    Tensor fine, coarse;               // [R,6] of composite(); coarse only with importance sampling
    int64_t samples = 0, marched = 0;  // shaded, and stepped to before the dark ones were left out
  };
  struct Sampling {
    RandomKey key;
    bool jitter = false, skim = true;  // skim: leave out samples behind surfaces
  };
  bool marching() const { return config_.sampling == "occupancy"; }
  MarchOptions march_options() const;
  Rendered shade(const Rays& rays, const Sampling& how) const;
  Rendered shade_marched(const Rays& rays, const Sampling& how) const;
  Rendered shade_importance(const Rays& rays, const Sampling& how) const;
  Tensor shade_edges(const Field& field, const Rays& rays, const Tensor& edges, const Tensor& place,
                     Tensor* weights) const;
  Tensor thickness(const Tensor& points) const;
  void append_pixels(Picture& picture, const std::vector<float>& values) const;
  Tensor background_for(int64_t rays, const RandomKey& key) const;
  Tensor pixel_loss(const Tensor& rendered, const Tensor& truth, const Tensor& used) const;

  NerfConfig config_;
  SceneFrame frame_;
  RayRange range_;
  bool has_alpha_ = false;
  uint64_t seed_ = 0;
  Params params_;
  std::unique_ptr<Field> field_, coarse_;
  std::unique_ptr<OccupancyGrid> occupancy_;
  std::unique_ptr<RayBank> bank_;
  int64_t rays_ = 0;  // of the next step: follows the samples a ray costs
  int64_t last_samples_ = 0;
  int64_t lit_permille_ = 1000;  // of the samples marched to, those that get light
};

}  // namespace cloam
