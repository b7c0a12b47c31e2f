// How a splat training draws: a photograph and what the gaussians show of it, and the picture of a view.
#pragma once
#include "models/batches/image_source.h"
#include "models/gaussians/exports_gaussians.h"
#include "models/methods/camera_refinement.h"
#include "models/nn/params.h"
#include "models/scene/view.h"
#include "models/splat/draw.h"
#include "models/splat/settings.h"

namespace cloam {

struct SplatConfig {
  std::string initial = "auto";     // as InitialOptions::kind
  int initial_random = 20000;       // gaussians
  std::string background = "auto";  // auto | black | white | random
  bool antialiased = false;
  float near = 0.01f;  // of the scene's extent
  HarmonicSteps harmonics;
  float ssim = 0.2f;   // weight; 1 - ssim is that of the absolute difference
  float depth = 0.1f;  // weight of what depth maps say
  GaussianRates rates;
  bool exposure = false;        // a gain and an offset for each channel of each training image, their means 1 and 0
  float rate_exposure = 0.01f;  // falls to a tenth
  GrowthOptions growth;
  CameraSettings cameras;
};

class SplatRenderer {
 public:
  /// The settings and the parameters must outlive this. radius: of the cameras, scene units.
  SplatRenderer(const SplatConfig& config, const Scene& scene, const Params& parameters, double radius);
  struct Compared {
    Tensor picture, truth;  // [3,H,W] on one background, black where a mask says ignore
    Drawn drawn;
    Tensor depth_error;  // [1]: the mean of depth_errors over all pixels; empty: there is no depth map, or no weight
  };
  struct Comparison {
    size_t place;  // of the photograph, and of its exposure and its pose
    const CameraRefinement& cameras;
    const Progress& progress;
    Tensor probe;  // see DrawOptions
  };
  /// As the gaussians show a photograph.
  Compared compare(const Photograph& photograph, const Comparison& how) const;
  Picture picture(const View& view) const;
  GaussianDrawing drawing() const { return {near_, config_.antialiased, bright()}; }

 private:
  Tensor background_for(const Progress& progress) const;
  Tensor exposed(const Tensor& planes, size_t photograph) const;
  bool bright() const { return config_.background == "white" || (config_.background == "auto" && has_alpha_); }

  const SplatConfig& config_;
  const Params& params_;
  bool has_alpha_;
  float near_;
};

}  // namespace cloam
