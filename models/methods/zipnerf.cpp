// Zip-NeRF: settings, batches, losses.
#include "models/methods/zipnerf.h"

#include "models/batches/pixel_targets.h"
#include "runtime/error.h"

namespace cloam {
namespace {

// Streams of random numbers within a step; others are the renderer's.
enum ZipBatchStream : uint32_t { kZipPixels = 0, kZipBackground = 3 };

constexpr float kSharpening = 10.f;  // how fast samples come to follow the proposals (mip-NeRF 360, eq. 18)

}  // namespace

void ZipNerf::configure(Config& c) {
  ZipNerfConfig& o = config_;
  c.bind("grid.levels", o.field.grid.levels, "levels of the field's hash grid", {1, 32});
  c.bind("grid.features", o.field.grid.features, "features a level (1, 2 or 4)", {1, 4});
  c.bind("grid.log2_rows", o.field.grid.log2_rows, "log2 of the table rows a level", {1, 28});
  c.bind("grid.coarsest", o.field.grid.coarsest, "cells per axis at the coarsest level of all grids", {1, 1 << 16});
  c.bind("grid.finest", o.field.grid.finest, "cells per axis at the finest level", {1, 1 << 20});
  c.bind("space.unit", o.unit,
         "what is 1 in contracted space: viewing, the cameras' mean distance from what they look at; path, in driving "
         "logs four times as much: about the length of the path",
         {"viewing", "path"});
  c.bind("field.width", o.field.width, "width of the density network", {1, 4096});
  c.bind("field.density", o.field.density, "activation of the density: softplus or exp", {"softplus", "exp"});
  c.bind("field.bottleneck", o.field.bottleneck, "features that it gives to the colour network", {1, 4096});
  c.bind("field.colour_width", o.field.colour_width, "width of the colour network", {1, 4096});
  for (size_t i = 0; i < o.proposals.size(); i++) {
    const std::string name = "proposal" + std::to_string(i + 1);
    c.bind(name + ".levels", o.proposals[i].levels, name + ": levels of its grid, a feature each", {1, 32});
    c.bind(name + ".finest", o.proposals[i].finest, name + ": cells per axis at the finest level", {1, 1 << 20});
    c.bind(name + ".pulse", o.proposals[i].pulse, name + ": half width that the interlevel loss blurs by", {1e-6, 1});
  }
  c.bind("proposals.log2_rows", o.proposal_log2_rows, "log2 of the table rows a level of proposals", {1, 28});
  c.bind("proposals.width", o.proposal_width, "width of the proposals' networks", {1, 4096});
  c.bind("samples.proposal", o.proposal_samples, "samples a ray of each proposal", {2, 4096});
  c.bind("samples.field", o.field_samples, "samples a ray of the field", {2, 4096});
  c.bind("sampling.multisamples", o.multisamples, "places that a sample is read at: 6 in the cone, or 1", {1, 6});
  c.bind("sampling.proposal_multisamples", o.proposal_multisamples, "the same of proposals", {1, 6});
  c.bind("sampling.downweight", o.downweight, "levels finer than a place is wide count less");
  c.bind("sampling.pixel_rays", o.pixel_rays, "rays a pixel of pictures: 1 or 4", {1, 4});
  c.bind("background", o.background, "background colour: auto, white, random or none", kBackgrounds);
  c.bind("batch.rays", o.batch_rays, "rays a step", {1, 1 << 22});
  c.bind("batch.coarse", o.coarse,
         "share of the rays that see squares of 2x2 or 4x4 pixels, as those of smaller photos", {0, 1});
  c.bind("train.loss", o.loss, "pixel loss: square or charbonnier", kPixelLosses);
  c.bind("weight.interlevel", o.interlevel, "weight of the anti-aliased interlevel loss");
  c.bind("weight.distortion", o.distortion, "weight of the distortion loss");
  c.bind("weight.decay", o.decay, "weight of the grids' mean squares");
  c.bind("weight.depth", o.depth, "weight of the difference from depth maps, where there are any");
  c.bind("train.rate", o.learning_rate, "learning rate of Adam");
  c.bind("train.final_rate", o.final_rate, "learning rate at the last step, as a fraction of train.rate");
  c.bind("train.warm_up", o.warm_up, "steps until the learning rate is reached", kStepsOrNone);
  bind_cameras(c, o.cameras);
}

void ZipNerf::build(const Scenes& scenes, uint64_t seed) {
  if (scenes.size() != 1) throw Error(Fault::usage, text("zipnerf trains on one capture, not ", scenes.size()));
  seed_ = seed;
  has_alpha_ = scenes.front().has_alpha;
  renderer_ = std::make_unique<ZipNerfRenderer>(config_, scenes.front(), Scope{params_, "", seed});
  cameras_.build(config_.cameras, scenes.front(), params_);
}

void ZipNerf::load_data(std::vector<TrainingData> data) {
  const auto& [scene, photos] = data.front();
  pixels_ = std::make_unique<PixelSource>(*scene.get(), photos, renderer_->frame(), renderer_->range());
}

MemoryPlan ZipNerf::memory(const PhotoSizes& photos) const {
  MemoryPlan plan = memory_of(params_);
  plan.images = photos.bytes + 16 * photos.largest;  // and directions, widths
  plan.work = 2 * plan.parameters + static_cast<uint64_t>(int64_t{config_.batch_rays} * renderer_->bytes_per_ray());
  plan.smaller = "smaller --set batch.rays or grid.log2_rows would fit";
  return plan;
}

ParameterGroups ZipNerf::groups() const {
  ParameterGroup all;
  all.rate = config_.learning_rate;
  all.schedule = {config_.final_rate, 0, 0, config_.warm_up};
  all.beta2 = 0.99f;
  all.epsilon = 1e-15f;
  ParameterGroups groups = {all};
  cameras_.add_groups(groups);
  return groups;
}

Step ZipNerf::step(const Progress& progress, const Tensors& wanted) {
  const RandomKey key{seed_, static_cast<uint32_t>(progress.step), 0};
  const int64_t rays = config_.batch_rays;
  const LearnedCameras cameras = cameras_.of_pixels(pixels_->poses(), renderer_->frame().scale);
  const PixelBatch batch = pixels_->draw(rays, key.of_stream(kZipPixels), progress.share, cameras, config_.coarse);
  const float done = progress.fraction(), sharpness = kSharpening * done / ((kSharpening - 1) * done + 1);
  const ZipNerfRenderer::Rendered seen =
      renderer_->shade({batch.rays, batch.widths * kConeOfPixel}, {key, true, progress.share, rays, sharpness});
  const Tensor background =
      background_of({config_.background, has_alpha_}, rays, key.of_stream(kZipBackground), progress.share);
  const Tensor colour = slice(seen.rays, 1, 0, 3) + background * (1.f - slice(seen.rays, 1, 3, 4));
  const Tensor truth = truth_over(background, batch, has_alpha_);
  const Tensor interlevel = renderer_->interlevel(seen);
  Tensor loss = pixel_loss(config_.loss, colour, truth, batch.used) + interlevel * config_.interlevel +
                distortion_loss(seen.histograms.back()) * config_.distortion + renderer_->decay() * config_.decay;
  if (batch.depths)
    loss = loss + config_.depth * depth_loss({seen.middles, seen.histograms.back().weights, unsqueeze(batch.depths, 1)},
                                             batch.depths);
  Step step = step_of(loss, wanted);
  step.weight = static_cast<double>(progress.share.size(rays)) / static_cast<double>(rays);
  step.figures = {psnr_figure(mean(square(stop_gradient(colour) - truth))),
                  {"rays", static_cast<double>(rays)},
                  {"interlevel", 0, interlevel}};
  for (const Figure& figure : cameras_.figures()) step.figures.push_back(figure);
  return step;
}

Picture ZipNerf::render(const View& view) {
  return renderer_->picture(view, has_alpha_ || config_.background == "white" ? 1.f : 0.f);
}

}  // namespace cloam
