// Zip-NeRF along rays: two levels of proposals, then the field, each sampled in the cones of pixels.
#pragma once
#include <array>

#include "models/fields/zip_field.h"
#include "models/mesh/has_density.h"
#include "models/methods/camera_refinement.h"
#include "models/render/cones.h"
#include "models/render/proposals.h"
#include "models/render/rays.h"
#include "models/render/scene_frame.h"

namespace cloam {

struct ZipNerfConfig {
  ZipFieldOptions field;
  // Of contracted space: viewing (fit_scene) or path (fit_path). Presets have path; runs of before, which do not say
  // it, are read by this default.
  std::string unit = "viewing";
  struct Proposal {
    int levels, finest;
    float pulse;  // half width of what the interlevel loss blurs with
  };
  std::array<Proposal, 2> proposals = {{{6, 512, 0.03f}, {8, 2048, 0.003f}}};
  int proposal_log2_rows = 21, proposal_width = 64;
  int proposal_samples = 64, field_samples = 32;    // a ray and level
  int multisamples = 6, proposal_multisamples = 6;  // a sample: 6 or 1
  bool downweight = true;
  int pixel_rays = 1;  // pictures: 1 or 4
  std::string background = "auto";
  int batch_rays = 65536;
  float coarse = 0;                  // of them: share whose pixels are squares of the photos'
  std::string loss = "charbonnier";  // or square
  float learning_rate = 1e-2f, final_rate = 0.1f;
  int warm_up = 5000;
  float interlevel = 0.01f, distortion = 0.005f, decay = 0.1f, depth = 0.1f;
  CameraSettings cameras;
};

class ZipNerfRenderer {
 public:
  /// Declares parameters under `root`. The settings must outlive this. Fault::usage for those that do not fit together.
  ZipNerfRenderer(const ZipNerfConfig& config, const Scene& scene, const Scope& root);
  struct Sampling {
    RandomKey key = {};
    bool random = false;
    Share share = {};
    int64_t all = 0;        // of so many rays these are the share
    float sharpness = 1.f;  // exponent of the proposals' weights that samples are drawn by
  };
  struct Rendered {
    Tensor rays;                           // [R,5]: colour times opacity, opacity, depth times opacity
    std::vector<RayHistogram> histograms;  // of the proposals and, last, of the field
    Tensor middles;                        // [R,N] of the field's samples: distances
  };
  Rendered shade(const Cones& cones, const Sampling& how) const;
  /// Block by block; `back`: how bright it is where nothing is.
  Picture picture(const View& view, float back) const;
  /// The last field as a function of the place, read as wide as a pixel at a distance of 1.
  DensityField density_field() const;
  /// The interlevel loss of both proposals.
  Tensor interlevel(const Rendered& seen) const;
  /// Of all grids.
  Tensor decay() const;
  /// Of activations of a ray, in training.
  int64_t bytes_per_ray() const;
  const SceneFrame& frame() const { return frame_; }
  /// How far rays reach, in normalised units.
  RayRange range() const { return range_; }

 private:
  WideSamples places_of(const std::vector<float>& world) const;
  WideSamples samples_of(const Cones& cones, const Tensor& edges, const Sampling& how, uint32_t level) const;
  Picture picture_of_rays(const View& view, float back) const;

  const ZipNerfConfig& config_;
  SceneFrame frame_;
  RayRange range_ = {0.05f, 1000.f};
  std::vector<std::unique_ptr<ZipDensity>> proposals_;
  std::unique_ptr<ZipField> field_;
};

}  // namespace cloam
