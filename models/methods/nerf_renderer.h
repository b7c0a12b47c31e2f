// What NeRF's fields look like along rays: samples from marching through an occupancy grid, drawn where a coarse field
// is dense, or evenly spread, and the quadrature over them.
#pragma once
#include <memory>

#include "models/fields/field.h"
#include "models/mesh/has_density.h"
#include "models/methods/camera_refinement.h"
#include "models/render/occupancy.h"
#include "models/render/rays.h"
#include "models/train/shows_samples.h"

namespace cloam {

struct NerfConfig {
  std::string space = "auto";  // auto | contract | ndc
  float nearest = 0.f;         // ndc: of the nearest thing, in scene units; 0: the capture says it
  FieldOptions field;
  OccupancyOptions occupancy;
  std::string sampling = "occupancy";               // occupancy | importance | uniform
  std::string background = "auto";                  // auto | white | random | none
  int batch_rays = 1024;                            // rays a step; occupancy: at most 16 times as many
  int batch_samples = 65536;                        // occupancy: samples a step aims at
  int coarse_samples = 64, fine_samples = 128;      // a ray; uniform: as many as coarse
  float min_step = 0.f;                             // in normalised units; 0: chosen by the kind of scene
  float cone = 0.03f;                               // unbounded scenes: step length over distance
  float learning_rate = 1e-2f, final_rate = 0.03f;  // factor reached at the horizon
  float decay_start = 0.3f;                         // share of the horizon before the rate falls
  int decay_steps = 0;          // not 0: the rate reaches final_rate after so many steps, whatever the horizon
  float distortion = 0.005f;    // mip-NeRF 360: draws each ray's weights together
  float depth = 0.03f;          // of what depth maps say
  std::string loss = "square";  // square | charbonnier
  int occupancy_every = 16, occupancy_start = 64;
  CameraSettings cameras;
};

class NerfRenderer {
 public:
  /// Declares the fields' parameters under `root`. The settings must outlive this. Fault::usage for those that do not
  /// fit together.
  NerfRenderer(const NerfConfig& config, const Scene& scene, const Scope& root);
  struct Along {
    Tensor distance, ray, weight;  // [S] of the samples
  };
  struct Rendered {
    Tensor fine, coarse;               // [R,6] of composite(); coarse only with importance sampling
    Along along = {};                  // what `fine` is composited of
    int64_t samples = 0, marched = 0;  // shaded, and stepped to before the dark ones were left out
  };
  struct Sampling {
    RandomKey key = {};
    bool jitter = false, skim = true;  // skim: leave out samples behind surfaces
    Share share = {};                  // the rays are this one
    int64_t all = 0;                   // of so many; 0: they are all
    bool distances = false;            // depths in NDC as distances
  };
  Rendered shade(const Rays& rays, const Sampling& how) const;
  /// Block by block; `back`: how bright it is where nothing is.
  Picture picture(const View& view, float back) const;
  /// What a picture of the view shades along the rays of one row of pixels.
  std::vector<RaySample> samples(const View& view, int row) const;
  /// What pictures show, as a function of the place: of the one field, or the fine one. Fault::usage in NDC.
  DensityField density_field() const;
  /// After a step: the occupancy grid follows the field.
  void follow(int64_t step, uint64_t seed);
  bool marching() const { return config_.sampling == "occupancy"; }
  /// A ray, of all fields, where it does not depend on the scene.
  int64_t samples_per_ray() const;
  /// Of activations, in training.
  int64_t bytes_per_sample() const { return field_->bytes_per_sample(); }
  const SceneFrame& frame() const { return frame_; }
  /// Of the grid, if there is one.
  TensorMap state() const { return marching() ? occupancy_->state() : TensorMap{}; }
  void restore(const TensorMap& state);

 private:
  MarchOptions march_options() const;
  static Tensor random_of(int64_t count, int64_t numbers, const Sampling& how, uint32_t stream);
  static Tensor places(const Rays& rays, int64_t numbers, const Sampling& how, uint32_t stream);
  // path: the rays in the field's space.
  Rendered shade_marched(const Rays& rays, const Rays& path, const Sampling& how) const;
  Rendered shade_importance(const Rays& rays, const Rays& path, const Sampling& how) const;
  Rendered shade_uniform(const Rays& rays, const Rays& path, const Sampling& how) const;
  struct Edges {
    Tensor edges, place;  // [R,N+1]; [R,N] in [0,1)
    bool distances;
  };
  Rendered shade_edges(const Field& field, const Rays& rays, const Rays& path, const Edges& at) const;
  Tensor even_edges(const Rays& path) const;
  Tensor depths(const Rays& rays, const Tensor& t, const Tensor& ray, bool distances) const;
  Tensor per_length(const Tensor& sigma) const;
  Tensor thickness(const Tensor& points) const;

  const NerfConfig& config_;
  SceneFrame frame_;
  std::unique_ptr<Field> field_, coarse_;
  std::unique_ptr<OccupancyGrid> occupancy_;
};

}  // namespace cloam
