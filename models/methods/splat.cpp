// Gaussian splatting, composed of projection, tiles, blending and a growth strategy.
#include "models/methods/splat.h"

#include <algorithm>

#include "models/gaussians/initialise.h"
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
  c.bind("initial", o.initial, "initial Gaussians: auto, points, lidar, depths, random, or a file of points or splats");
  c.bind("initial.random", o.initial_random, "number of random initial Gaussians", {1, 1 << 28});
  c.bind("background", o.background, "background colour: auto, black, white or random",
         {"auto", "black", "white", "random"});
  c.bind("antialiased", o.antialiased, "reduce opacities to make up for the pixel filter (Mip-Splatting)");
  c.bind("near", o.near, "near plane, relative to the cameras' radius");
  bind_harmonics(c, o.harmonics);
  c.bind("weight.ssim", o.ssim, "weight of 1 - SSIM; the rest is the weight of L1", {0, 1});
  c.bind("weight.depth", o.depth, "weight of the difference from depth maps, where there are any");
  bind_rates(c, o.rates);
  c.bind("exposure", o.exposure, "learn a gain and an offset per image and channel, with means 1 and 0");
  c.bind("train.rate_exposure", o.rate_exposure, "learning rate of the exposures; it falls to a tenth");
  bind_growth(c, o.growth);
  bind_cameras(c, config_.cameras);
}

void Splat::build(const Scenes& scenes, uint64_t seed) {
  if (scenes.size() != 1) throw Error(Fault::usage, text("splat trains on one capture, not ", scenes.size()));
  const Scene& scene = scenes.front();
  region_ = camera_region(scene);
  common_.up = scene.up;
  common_.metric = scene.metric;
  renderer_ = std::make_unique<SplatRenderer>(config_, scene, params_, region_.radius);
  growth_ = make_growth(config_.growth, region_);
  // A capture that comes from a run folder has no files: the gaussians come with the checkpoint.
  const bool restored = scene.root.empty();
  InitialGaussians first = {one_gaussian()};
  if (!restored) first = initial_gaussians(scene, {config_.initial, config_.initial_random, seed, uses_depths()});
  put(first.gaussians);
  grey_ = first.grey;
  from_depths_ = first.from_depths;
  const auto frames = static_cast<int64_t>(frames_of(scene, Split::train).size());
  if (config_.exposure)
    params_["exposure"] = parameter(std::vector<float>(static_cast<size_t>(6 * frames), 0), {frames, 6});
  cameras_.build(config_.cameras, scene, params_);
}

std::vector<std::string> Splat::warnings(const Scene& scene) const {
  if (config_.initial != "auto" || scene.cloud.count() > 0 || !scene.sweeps.empty() || from_depths_) return {};
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
  if (!grey_ && !from_depths_) return;
  std::vector<PosedPhoto> photos;
  for (const FramePixels& photo : pixels.frames) {
    const Photograph& taken = photos_->photographs()[photos.size()];
    photos.push_back({photo, taken.camera, taken.world_from_camera});
  }
  Gaussians begun =
      from_depths_ ? gaussians_from_points(points_from_depths(photos, config_.initial_random)) : gaussians();
  if (grey_) colour_from(photos, begun);
  put(begun);
}

MemoryPlan Splat::memory(const PhotoSizes& photos) const {
  constexpr uint64_t kWork = 4 * 170 + 10 * 100, kPixel = 160;  // gradients, projections, ten pairs with tiles
  const auto most = static_cast<uint64_t>(std::max<int64_t>(gaussian_count(params_), config_.growth.max_count));
  MemoryPlan plan;
  plan.parameters = most * kGaussianBytes;
  plan.optimiser = 2 * plan.parameters;
  plan.images = photos.bytes;
  plan.work = most * kWork + photos.largest * kPixel;
  const uint64_t others = plan.images + photos.largest * kPixel, budget = memory_budget();
  if (budget > others)
    plan.smaller = text("--set growth.max=", (budget - others) / (3 * kGaussianBytes + kWork), " fits");
  return plan;
}

ParameterGroups Splat::groups() const {
  ParameterGroups groups = gaussian_groups(config_.rates, "", region_.radius);
  groups.push_back({"exposure", config_.rate_exposure, {kFinalExposure}});
  groups.back().epsilon = groups.front().epsilon;
  cameras_.add_groups(groups);
  return groups;
}

Step Splat::step(const Progress& progress, const Tensors& wanted) {
  const size_t which = photos_->draw(progress.seed, progress.step, progress.share);
  const int64_t count = gaussian_count(params_);
  const Tensor probe =
      config_.growth.absolute ? parameter(std::vector<float>(static_cast<size_t>(2 * count)), {count, 2}) : Tensor();
  const auto [picture, truth, drawn, depth_error] =
      renderer_->compare(photos_->photographs()[which], {which, cameras_, progress, probe});
  const Likeness alike = likeness(picture, truth);
  Tensor loss = (1.f - config_.ssim) * alike.l1 + config_.ssim * (1.f - alike.ssim);
  if (depth_error) loss = loss + config_.depth * depth_error;
  if (const Tensor penalty = growth_->penalty(splat_model(params_, 0).cloud)) loss = loss + penalty;
  Tensors all = wanted;
  all.push_back(probe ? probe : drawn.seen);
  Step step = step_of(loss, all);
  observed_.add(drawn, step.gradients.back());
  step.gradients.pop_back();
  step.figures = {psnr_figure(mean(square(picture - truth))), {"gaussians", static_cast<double>(count)}};
  for (const Figure& figure : cameras_.figures()) step.figures.push_back(figure);
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
