// Gaussian splatting, composed of projection, tiles, blending and a growth strategy.
#include "models/methods/splat.h"

#include <algorithm>

#include "models/render/undistort.h"
#include "models/splat/initial_gaussians.h"
#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/ops/ssim.h"

namespace cloam {
namespace {

constexpr float kFinalExposure = 0.1f;  // factor on the rate

}  // namespace

void Splat::configure(Config& c) {
  SplatConfig& o = config_;
  c.bind("initial", o.initial, "initial Gaussians: auto, points, lidar, random, or a file of points or splats");
  c.bind("initial.random", o.initial_random, "number of random initial Gaussians", {1, 1 << 28});
  c.bind("background", o.background, "background colour: auto, black, white or random");
  c.bind("antialiased", o.antialiased, "reduce opacities to make up for the pixel filter (Mip-Splatting)");
  c.bind("near", o.near, "near plane, relative to the cameras' radius");
  c.bind("sh.degree", o.sh_degree, "degree of the colours' spherical harmonics", {0, kSphericalBands});
  c.bind("sh.every", o.sh_every, "steps before the next degree is used (at most a tenth of all steps)", kSteps);
  c.bind("weight.ssim", o.ssim, "weight of 1 - SSIM; the rest is the weight of L1", {0, 1});
  c.bind("train.rate_means", o.rate_means, "learning rate of the means, relative to the cameras' radius");
  c.bind("train.final_means", o.final_means,
         "learning rate of the means at the last step, as a fraction of train.rate_means");
  c.bind("train.rate_first", o.rate_first, "learning rate of the base colours");
  c.bind("train.rate_rest", o.rate_rest, "learning rate of the view-dependent colours");
  c.bind("train.rate_opacities", o.rate_opacities, "learning rate of the opacities");
  c.bind("train.rate_scales", o.rate_scales, "learning rate of the scales");
  c.bind("train.rate_rotations", o.rate_rotations, "learning rate of the rotations");
  c.bind("exposure", o.exposure, "learn a gain and an offset per image and channel, with means 1 and 0");
  c.bind("train.rate_exposure", o.rate_exposure, "learning rate of the exposures; it falls to a tenth");
  c.bind("growth.strategy", o.growth.strategy, "densify (the paper) or mcmc");
  c.bind("growth.start", o.growth.from, "step after which the number of Gaussians may change", kStepsOrNone);
  c.bind("growth.every", o.growth.every, "steps between changes of the number of Gaussians", kSteps);
  c.bind("growth.max", o.growth.max_count, "largest number of Gaussians", {1, 1 << 28});
  c.bind("growth.gradient", o.growth.gradient, "densify: mean gradient above which a Gaussian is cloned or split");
  c.bind("growth.absolute", o.growth.absolute, "densify: sum the absolute gradients of the pixels (AbsGS)");
  c.bind("growth.split_scale", o.growth.small,
         "densify: scale, relative to the cameras' radius, above which a Gaussian is split");
  c.bind("growth.prune_scale", o.growth.large,
         "densify: scale, relative to the radius or its distance, above which a Gaussian is removed");
  c.bind("growth.prune_opacity", o.growth.faint, "opacity below which a Gaussian is removed or moved", {0, 1});
  c.bind("growth.reset_every", o.growth.reset_every, "densify: steps between resets of the opacities", kSteps);
  c.bind("growth.noise", o.growth.noise, "mcmc: noise on the means, relative to their learning rate");
  c.bind("growth.weight_opacity", o.growth.weight_opacity, "mcmc: weight of the mean opacity");
  c.bind("growth.weight_scale", o.growth.weight_scale, "mcmc: weight of the mean scale");
}

void Splat::build(const Scenes& scenes, uint64_t seed) {
  if (scenes.size() != 1) throw Error(Fault::usage, text("splat trains on one capture, not ", scenes.size()));
  const Scene& scene = scenes.front();
  cameras_ = camera_region(scene);
  common_.up = scene.up;
  common_.metric = scene.metric;
  renderer_ = std::make_unique<SplatRenderer>(config_, scene, params_, cameras_.radius);
  growth_ = make_growth(config_.growth, cameras_);
  // A capture that comes from a run folder has no files: the gaussians come with the checkpoint.
  const bool restored = scene.root.empty();
  InitialGaussians first = {{{0, 0, 0}, {0, 0, 0}, {1, 0, 0, 0}, {0}, {0, 0, 0}, std::vector<float>(45)}};
  if (!restored) first = initial_gaussians(scene, {config_.initial, config_.initial_random, seed});
  put(first.gaussians);
  grey_ = first.grey;
  const auto frames = static_cast<int64_t>(frames_of(scene, Split::train).size());
  if (config_.exposure)
    params_["exposure"] = parameter(std::vector<float>(static_cast<size_t>(6 * frames), 0), {frames, 6});
}

std::vector<std::string> Splat::warnings(const Scene& scene) const {
  if (config_.initial != "auto" || scene.cloud.count() > 0 || !scene.sweeps.empty()) return {};
  return {
      "no points: Gaussians start at random positions in the region that the cameras see; a COLMAP model with points "
      "gives a better start (cloam process PHOTOS -o DATA makes one)"};
}

void Splat::put(const Gaussians& gaussians) {
  put_gaussians(params_, gaussians);
  observed_.restart(gaussian_count(params_));
}

void Splat::fit_to(const TensorMap& parameters) {
  const auto found = parameters.find("opacities");
  if (found == parameters.end() || found->second.shape.size() != 1) return;
  put_zeros(params_, found->second.shape[0]);
  observed_.restart(found->second.shape[0]);
}

void Splat::load_data(std::vector<TrainingData> data) {
  const Pixels pixels = undistorted(data.front().photos.all());
  photos_ = std::make_unique<PhotoSource>(*data.front().scene.get(), pixels);
  if (!grey_) return;
  std::vector<PosedPhoto> photos;
  for (const FramePixels& photo : pixels.frames) {
    const Photograph& taken = photos_->photographs()[photos.size()];
    photos.push_back({photo, taken.camera, taken.world_from_camera});
  }
  Gaussians coloured = gaussians();
  colour_from(photos, coloured);
  put(coloured);
}

MemoryPlan Splat::memory(const PhotoSizes& photos) const {
  constexpr uint64_t kNumbers = 4 * 59;                         // bytes of a gaussian's parameters
  constexpr uint64_t kWork = 4 * 170 + 10 * 100, kPixel = 160;  // gradients, projections, ten pairs with tiles
  const auto most = static_cast<uint64_t>(std::max<int64_t>(gaussian_count(params_), config_.growth.max_count));
  MemoryPlan plan;
  plan.parameters = most * kNumbers;
  plan.optimiser = 2 * plan.parameters;
  plan.images = photos.bytes;
  plan.work = most * kWork + photos.largest * kPixel;
  const uint64_t others = plan.images + photos.largest * kPixel, budget = memory_budget();
  if (budget > others) plan.smaller = text("--set growth.max=", (budget - others) / (3 * kNumbers + kWork), " fits");
  return plan;
}

ParameterGroups Splat::groups() const {
  const float means = config_.rate_means * static_cast<float>(cameras_.radius);
  ParameterGroups groups = {{"means", means, {config_.final_means}},
                            {"scales", config_.rate_scales},
                            {"rotations", config_.rate_rotations},
                            {"opacities", config_.rate_opacities},
                            {"sh_first", config_.rate_first},
                            {"sh_rest", config_.rate_rest},
                            {"exposure", config_.rate_exposure, {kFinalExposure}}};
  for (ParameterGroup& group : groups) group.epsilon = 1e-15f;
  return groups;
}

Step Splat::step(const Progress& progress, const Tensors& wanted) {
  const size_t which = photos_->draw(progress.seed, progress.step, progress.share);
  const int64_t count = gaussian_count(params_);
  const Tensor probe =
      config_.growth.absolute ? parameter(std::vector<float>(static_cast<size_t>(2 * count)), {count, 2}) : Tensor();
  const auto [picture, truth, drawn] = renderer_->compare(photos_->photographs()[which], which, progress, probe);
  const Likeness alike = likeness(picture, truth);
  Tensor loss = (1.f - config_.ssim) * alike.l1 + config_.ssim * (1.f - alike.ssim);
  if (const Tensor penalty = growth_->penalty(splat_model(params_, 0).cloud)) loss = loss + penalty;
  Tensors all = wanted;
  all.push_back(probe ? probe : drawn.seen);
  Step step = step_of(loss, all);
  observed_.add(drawn, step.gradients.back());
  step.gradients.pop_back();
  step.figures = {psnr_figure(mean(square(picture - truth))), {"gaussians", static_cast<double>(count)}};
  step.more = observed_.pending();
  step.sums = observed_.of_view();
  return step;
}

RowMoves Splat::grow(const Progress& progress) {
  const ParameterGroup means = group_of("means", groups());
  const Tensor shift = growth_->shift(splat_model(params_, 0).cloud, progress, means.rate_at(progress));
  if (shift) assign({{params_.at("means"), params_.at("means") + shift}});
  if (!growth_->due(progress)) return {};
  Gaussians all = gaussians();
  const GrowthMoves moves = growth_->grow(all, observed_.statistics(), progress);
  if (all.count() == 0)
    throw Error(Fault::diverged,
                text("no Gaussian is left after step ", progress.step,
                     "\n  fix: --set growth.prune_opacity=0.001, or lower rates; are the poses right?"));
  if (!moves.any()) return {};
  put(all);
  return row_moves(moves);
}

}  // namespace cloam
