// See splat_renderer.h.
#include "models/methods/splat_renderer.h"

#include <algorithm>
#include <cmath>

#include "models/batches/pixel_targets.h"
#include "models/render/undistort.h"
#include "models/splat/parameters.h"

namespace cloam {
namespace {

constexpr uint32_t kBackgroundStream = 1;  // stream of random numbers within a step
constexpr float kLeastOpacity = 1e-2f;     // of a pixel whose depth is asked for

/// The mean over all pixels. Where gaussians cover a pixel in part, what they are behind is that of what covers it.
Tensor mean_depth_error(const Drawn& drawn, const Tensor& depths) {
  const Tensor opacity = maximum(1.f - drawn.transmittance, kLeastOpacity);
  return mean(depth_errors(reshape(slice(drawn.planes, 0, 3, 4), depths.shape()) / opacity, depths));
}

}  // namespace

SplatRenderer::SplatRenderer(const SplatConfig& config, const Scene& scene, const Params& parameters, double radius)
    : config_(config),
      params_(parameters),
      has_alpha_(scene.has_alpha),
      near_(config.near * static_cast<float>(radius)) {}

/// [3,1,1]
Tensor SplatRenderer::background_for(const Progress& progress) const {
  if (config_.background == "random")
    return random_uniform({3, 1, 1}, {progress.seed, static_cast<uint32_t>(progress.step), kBackgroundStream});
  return full({3, 1, 1}, bright() ? 1.f : 0.f);
}

Tensor SplatRenderer::exposed(const Tensor& planes, size_t photograph) const {
  if (!config_.exposure) return planes;
  const Tensor& all = params_.at("exposure");
  const auto row = static_cast<int64_t>(photograph);
  const Tensor own = slice(all, 0, row, row + 1) - mean(all, {{0}, true});
  return planes * exp(reshape(slice(own, 1, 0, 3), {3, 1, 1})) + reshape(slice(own, 1, 3, 6), {3, 1, 1});
}

SplatRenderer::Compared SplatRenderer::compare(const Photograph& photograph, const Comparison& how) const {
  Compared out;
  const bool has_depth = photograph.depth && config_.depth > 0;
  out.drawn = draw(
      splat_model(params_, degree_at(config_.harmonics, how.progress)), photograph.camera,
      view_matrix(photograph.world_from_camera),
      {near_, config_.antialiased, has_depth, how.probe, {}, how.cameras.move_of(how.place, photograph.listed_camera)});
  if (has_depth) out.depth_error = mean_depth_error(out.drawn, photograph.depth);
  const Tensor background = background_for(how.progress);
  const Tensor colours = has_depth ? slice(out.drawn.planes, 0, 0, 3) : out.drawn.planes;
  out.picture = exposed(colours + unsqueeze(out.drawn.transmittance, 0) * background, how.place);
  const Tensor rgba = cast(photograph.rgba, DType::f32) / 255.f;
  out.truth = slice(rgba, 0, 0, 3);
  if (has_alpha_) {
    const Tensor alpha = slice(rgba, 0, 3, 4);
    out.truth = out.truth * alpha + background * (1.f - alpha);
  }
  if (photograph.mask) {
    const Tensor used = unsqueeze(cast(photograph.mask, DType::f32) / 255.f, 0);
    out.truth = out.truth * used;
    out.picture = out.picture * used;
  }
  return out;
}

Picture SplatRenderer::picture(const View& view) const {
  const Camera pinhole = pinhole_around(view.camera);
  const Drawn drawn = draw(splat_model(params_, config_.harmonics.degree), pinhole, view_matrix(view.world_from_camera),
                           {near_, config_.antialiased, true});
  const float back = bright() ? 1.f : 0.f;
  const std::vector<float> planes = drawn.planes.to_host(), through = drawn.transmittance.to_host();
  const std::vector<float> directions = pixel_directions(pinhole);
  Picture out;
  out.width = pinhole.width;
  out.height = pinhole.height;
  const size_t pixels = through.size();
  for (size_t i = 0; i < pixels; i++) {
    for (size_t c = 0; c < 3; c++) out.rgb.push_back(std::clamp(planes[c * pixels + i] + back * through[i], 0.f, 1.f));
    const float opacity = 1 - through[i], *d = &directions[3 * i];
    out.opacity.push_back(opacity);
    const float along = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);  // of a distance of 1 ahead
    out.depth.push_back(opacity > 1e-3f ? planes[3 * pixels + i] / opacity * along : 0.f);
  }
  return resample(out, pixel_map(view.camera, pinhole));
}

}  // namespace cloam
