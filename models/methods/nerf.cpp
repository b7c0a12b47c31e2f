// NeRF: settings, batches, losses.
#include "models/methods/nerf.h"

#include <algorithm>
#include <cmath>

#include "models/batches/pixel_targets.h"
#include "models/io/tensors.h"
#include "runtime/error.h"

namespace cloam {
namespace {

// Streams of random numbers within a step; others are the renderer's.
enum NerfStream : uint32_t { kPixels = 0, kBackground = 3 };

constexpr int64_t kMaxRays = int64_t{16} << 22;  // a step, of any batch.rays
constexpr int64_t kAllLit = 1000;
constexpr int kWarmUp = 30;  // steps

}  // namespace

void Nerf::configure(Config& c) {
  NerfConfig& o = config_;
  c.bind("space.kind", o.space,
         "auto, contract (unbounded scenes) or ndc (photos that all look one way; auto: where LLFF's depths lie beside "
         "them)",
         {"auto", "contract", "ndc"});
  c.bind("space.nearest", o.nearest,
         "ndc: distance of the nearest thing, in units of the poses; 0: as the capture says", {0, 1e7});
  c.bind("field.kind", o.field.kind, "radiance field: hash, frequency or triplane", {"hash", "frequency", "triplane"});
  c.bind("field.levels", o.field.levels, "hash grid: levels", {1, 32});
  c.bind("field.features", o.field.features, "hash grid: features per level (1, 2 or 4)", {1, 4});
  c.bind("field.log2_rows", o.field.log2_rows, "hash grid: log2 of the table rows per level", {1, 28});
  c.bind("field.coarsest", o.field.coarsest, "hash grid: cells per axis at the coarsest level", {1, 1 << 16});
  c.bind("field.finest", o.field.finest, "hash grid: cells per axis at the finest level", {1, 1 << 20});
  c.bind("field.width", o.field.width, "width of the networks", {1, 4096});
  c.bind("field.depth", o.field.depth, "frequency encoding: layers", {1, 64});
  c.bind("field.point_frequencies", o.field.point_frequencies, "frequency encoding: frequencies of the position",
         {0, 32});
  c.bind("field.direction_frequencies", o.field.direction_frequencies,
         "frequency encoding: frequencies of the direction", {0, 32});
  c.bind("field.plane_channels", o.field.plane_channels, "tri-plane: channels per plane", {1, 1024});
  c.bind("field.plane_side", o.field.plane_side, "tri-plane: texels per axis", {2, 8192});
  c.bind("sampling", o.sampling, "occupancy (march through a grid), importance (coarse and fine network) or uniform",
         {"occupancy", "importance", "uniform"});
  c.bind("background", o.background, "background colour: auto, white, random or none", kBackgrounds);
  c.bind("batch.rays", o.batch_rays, "rays per step (occupancy sampling: initially)", {1, 1 << 22});
  c.bind("batch.samples", o.batch_samples, "occupancy sampling: target samples per step", {1, 1 << 28});
  c.bind("samples.coarse", o.coarse_samples, "importance and uniform sampling: stratified samples per ray", {1, 4096});
  c.bind("samples.fine", o.fine_samples, "importance sampling: additional samples per ray", {1, 4096});
  c.bind("march.min_step", o.min_step, "smallest step in normalised units; 0: chosen from the scene", {0, 1});
  c.bind("march.cone", o.cone, "unbounded scenes: step length divided by distance", {0, 1});
  c.bind("occupancy.side", o.occupancy.side, "occupancy grid: cells per axis", {2, 512});
  c.bind("occupancy.cells", o.occupancy.cells_per_update, "occupancy grid: cells visited per update", {64, 1 << 27});
  c.bind("occupancy.threshold", o.occupancy.threshold, "occupancy grid: density below which a cell is empty");
  c.bind("occupancy.every", o.occupancy_every, "occupancy grid: steps between updates", kSteps);
  c.bind("occupancy.start", o.occupancy_start, "occupancy grid: step of the first update", kStepsOrNone);
  c.bind("train.rate", o.learning_rate, "learning rate of Adam");
  c.bind("train.final_rate", o.final_rate, "learning rate at the last step, as a fraction of train.rate");
  c.bind("train.decay_start", o.decay_start, "fraction of the steps before the learning rate decays", kShareBelowOne);
  c.bind("train.decay_steps", o.decay_steps, "steps until the final learning rate; 0: the length of the training",
         kStepsOrNone);
  c.bind("weight.distortion", o.distortion, "weight of the distortion loss");
  c.bind("weight.depth", o.depth, "weight of the difference from depth maps, where there are any");
  c.bind("train.loss", o.loss, "pixel loss: square or charbonnier", kPixelLosses);
  bind_cameras(c, o.cameras);
}

void Nerf::build(const Scenes& scenes, uint64_t seed) {
  if (scenes.size() != 1) throw Error(Fault::usage, text("nerf trains on one capture, not ", scenes.size()));
  seed_ = seed;
  has_alpha_ = scenes.front().has_alpha;
  renderer_ = std::make_unique<NerfRenderer>(config_, scenes.front(), Scope{params_, "", seed});
  rays_ = config_.batch_rays;
  cameras_.build(config_.cameras, scenes.front(), params_);
}

void Nerf::load_data(std::vector<TrainingData> data) {
  const auto& [scene, photos] = data.front();
  pixels_ = std::make_unique<PixelSource>(*scene.get(), photos, renderer_->frame(), RayRange());
}

MemoryPlan Nerf::memory(const PhotoSizes& photos) const {
  MemoryPlan plan = memory_of(params_);
  plan.images = photos.bytes + 16 * photos.largest;  // and directions, widths
  const int64_t samples =
      renderer_->marching() ? config_.batch_samples : config_.batch_rays * renderer_->samples_per_ray();
  plan.work = 2 * plan.parameters + static_cast<uint64_t>(samples * (renderer_->bytes_per_sample() + 64));
  return plan;
}

ParameterGroups Nerf::groups() const {
  ParameterGroup all;
  all.rate = config_.learning_rate;
  all.schedule = {config_.final_rate, config_.decay_start, config_.decay_steps, kWarmUp};
  if (config_.field.kind != "frequency") all.beta2 = 0.99f, all.epsilon = 1e-15f;  // Mueller et al. 2022
  ParameterGroups groups = {all};
  cameras_.add_groups(groups);
  return groups;
}

Step Nerf::step(const Progress& progress, const Tensors& wanted) {
  const RandomKey key{seed_, static_cast<uint32_t>(progress.step), 0};
  const LearnedCameras cameras = cameras_.of_pixels(pixels_->poses(), renderer_->frame().scale);
  const PixelBatch batch = pixels_->draw(rays_, key.of_stream(kPixels), progress.share, cameras);
  // What lies behind a surface gets no light and no gradient. A pass through the density alone finds it, and pays once
  // a quarter of the samples are dark; until then it only looks now and then.
  skimmed_ = progress.step <= 3 || lit_permille_ < 750 || progress.step % 16 == 0;
  const NerfRenderer::Rendered seen = renderer_->shade(batch.rays, {key, true, skimmed_, progress.share, rays_});
  // In NDC, whose rays all end at something, too: colours behind haze can be anything.
  const bool by_itself = has_alpha_ || renderer_->frame().ndc;
  const Tensor background =
      background_of({config_.background, by_itself}, rays_, key.of_stream(kBackground), progress.share);
  const Tensor truth = truth_over(background, batch, has_alpha_);
  const auto colour = [&](const Tensor& rendered) {
    return slice(rendered, 1, 0, 3) + background * (1.f - slice(rendered, 1, 3, 4));
  };
  const Tensor fine = colour(seen.fine);
  const Tensor error = mean(square(stop_gradient(fine) - truth));
  samples_ = static_cast<double>(seen.samples);
  marched_ = static_cast<double>(seen.marched);
  const Tensor spread = mean(slice(seen.fine, 1, 5, 6)) * config_.distortion;
  const auto loss_of = [&](const Tensor& rendered) { return pixel_loss(config_.loss, rendered, truth, batch.used); };
  Tensor loss = loss_of(fine) + spread;
  if (seen.coarse) loss = loss + loss_of(colour(seen.coarse));
  if (batch.depths) {
    const auto& [distance, ray, weight] = seen.along;
    loss = loss + config_.depth * depth_loss({distance, weight, gather_rows(batch.depths, ray)}, batch.depths);
  }
  Step step = step_of(loss, wanted);
  step.weight = static_cast<double>(progress.share.size(rays_)) / static_cast<double>(rays_);
  step.counts = {&samples_, &marched_};
  step.figures = {psnr_figure(error),
                  {"rays", static_cast<double>(rays_)},
                  {"samples", samples_ * static_cast<double>(progress.share.ranks)}};
  for (const Figure& figure : cameras_.figures()) step.figures.push_back(figure);
  if (renderer_->marching())
    step.figures.push_back(
        {"lit", skimmed_ ? (samples_ + 1) / (marched_ + 1) : static_cast<double>(lit_permille_) / 1000});
  return step;
}

void Nerf::after_step(const Progress& progress) {
  if (skimmed_) lit_permille_ = kAllLit * (std::llround(samples_) + 1) / (std::llround(marched_) + 1);
  if (!renderer_->marching()) return;
  // Rays follow the samples they cost, slowly, so that a step keeps its size.
  const double per_ray = (samples_ + 1) / static_cast<double>(rays_);
  const double goal = std::clamp(config_.batch_samples / per_ray, double{kLeastRays}, 16.0 * config_.batch_rays);
  rays_ = std::max<int64_t>(kLeastRays, std::llround(0.8 * static_cast<double>(rays_) + 0.2 * goal));
  renderer_->follow(progress.step, seed_);
}

Picture Nerf::render(const View& view) {
  return renderer_->picture(view, has_alpha_ || config_.background == "white" ? 1.f : 0.f);
}

std::vector<RaySample> Nerf::samples(const View& view, int row) { return renderer_->samples(view, row); }

TensorMap Nerf::state() const {
  TensorMap out = renderer_->state();
  out["rays"] = named_integers({rays_, lit_permille_});
  return out;
}

void Nerf::restore(const TensorMap& state) {
  renderer_->restore(state);
  const std::vector<int64_t> stored = integers_from(state, "rays", 2);
  if (stored[0] < 1 || stored[0] > kMaxRays || stored[1] < 0 || stored[1] > kAllLit)
    throw Error(Fault::data, text("the checkpoint's state.rays is ", stored[0], ", ", stored[1], ", want 1 to ",
                                  kMaxRays, " rays and 0 to ", kAllLit, " lit samples of ", kAllLit));
  rays_ = stored[0];
  lit_permille_ = stored[1];
}

}  // namespace cloam
