// Gaussian splatting, composed of projection, tiles, blending and a growth strategy.
#include "models/methods/splat.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "models/io/tensors.h"
#include "models/render/undistort.h"
#include "models/splat/initial_gaussians.h"
#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/ops/ssim.h"

namespace cloam {
namespace {

constexpr float kFinalExposure = 0.1f;  // factor on the rate
enum Stream : uint32_t { kOrder = 0, kBackground = 1 };

/// One row of the parameters: name, shape after G, and where a file keeps it.
struct Part {
  const char* name;
  std::vector<int64_t> after;
  std::vector<float> Gaussians::*values;
};
const std::vector<Part>& parts() {
  static const std::vector<Part> all = {
      {"means", {3}, &Gaussians::means},         {"scales", {3}, &Gaussians::scales},
      {"rotations", {4}, &Gaussians::rotations}, {"opacities", {}, &Gaussians::opacities},
      {"sh_first", {3}, &Gaussians::sh_first},   {"sh_rest", {15, 3}, &Gaussians::sh_rest}};
  return all;
}

Shape shape_of(const Part& part, int64_t count) {
  Shape shape = {count};
  for (const int64_t size : part.after) shape.push_back(size);
  return shape;
}

/// [C,H,W] of [H,W,C] bytes.
Tensor planar(const std::vector<uint8_t>& pixels, int channels, int height, int width) {
  const size_t plane = static_cast<size_t>(height) * static_cast<size_t>(width);
  std::vector<uint8_t> out(plane * static_cast<size_t>(channels));
  for (size_t i = 0; i < plane; i++)
    for (size_t c = 0; c < static_cast<size_t>(channels); c++)
      out[c * plane + i] = pixels[i * static_cast<size_t>(channels) + c];
  return from_host(out, {channels, height, width});
}

}  // namespace

void Splat::configure(Config& c) {
  c.bind("initial", config_.initial, "initial Gaussians: auto, points, lidar, random, or a file of points or splats");
  c.bind("initial.random", config_.initial_random, "number of random initial Gaussians", {1, 1 << 28});
  c.bind("background", config_.background, "background colour: auto, black, white or random");
  c.bind("antialiased", config_.antialiased, "reduce opacities to make up for the pixel filter (Mip-Splatting)");
  c.bind("near", config_.near, "near plane, relative to the cameras' radius", kFromZero);
  c.bind("sh.degree", config_.sh_degree, "degree of the colours' spherical harmonics", {0, kSphericalBands});
  c.bind("sh.every", config_.sh_every, "steps before the next degree is used (at most a tenth of all steps)",
         {1, 1 << 30});
  c.bind("weight.ssim", config_.ssim, "weight of 1 - SSIM; the rest is the weight of L1", {0, 1});
  c.bind("train.rate_means", config_.rate_means, "learning rate of the means, relative to the cameras' radius",
         kFromZero);
  c.bind("train.final_means", config_.final_means,
         "learning rate of the means at the last step, as a fraction of train.rate_means", kFromZero);
  c.bind("train.rate_first", config_.rate_first, "learning rate of the base colours", kFromZero);
  c.bind("train.rate_rest", config_.rate_rest, "learning rate of the view-dependent colours", kFromZero);
  c.bind("train.rate_opacities", config_.rate_opacities, "learning rate of the opacities", kFromZero);
  c.bind("train.rate_scales", config_.rate_scales, "learning rate of the scales", kFromZero);
  c.bind("train.rate_rotations", config_.rate_rotations, "learning rate of the rotations", kFromZero);
  c.bind("exposure", config_.exposure, "learn a gain and an offset per image and channel, with means 1 and 0");
  c.bind("train.rate_exposure", config_.rate_exposure, "learning rate of the exposures; it falls to a tenth",
         kFromZero);
  c.bind("growth.strategy", config_.growth.strategy, "densify (the paper) or mcmc");
  c.bind("growth.start", config_.growth.from, "step after which the number of Gaussians may change", {0, 1 << 30});
  c.bind("growth.every", config_.growth.every, "steps between changes of the number of Gaussians", {1, 1 << 30});
  c.bind("growth.max", config_.growth.most, "largest number of Gaussians", {1, 1 << 28});
  c.bind("growth.gradient", config_.growth.gradient, "densify: mean gradient above which a Gaussian is cloned or split",
         kFromZero);
  c.bind("growth.absolute", config_.growth.absolute, "densify: sum the absolute gradients of the pixels (AbsGS)");
  c.bind("growth.split_scale", config_.growth.small,
         "densify: scale, relative to the cameras' radius, above which a Gaussian is split", kFromZero);
  c.bind("growth.prune_scale", config_.growth.large,
         "densify: scale, relative to the radius or its distance, above which a Gaussian is removed", kFromZero);
  c.bind("growth.prune_opacity", config_.growth.faint, "opacity below which a Gaussian is removed or moved", {0, 1});
  c.bind("growth.reset_every", config_.growth.reset_every, "densify: steps between resets of the opacities",
         {1, 1 << 30});
  c.bind("growth.noise", config_.growth.noise, "mcmc: noise on the means, relative to their learning rate", kFromZero);
  c.bind("growth.weight_opacity", config_.growth.weight_opacity, "mcmc: weight of the mean opacity", kFromZero);
  c.bind("growth.weight_scale", config_.growth.weight_scale, "mcmc: weight of the mean scale", kFromZero);
}

void Splat::build(const Scenes& scenes, uint64_t seed) {
  if (scenes.size() != 1) throw Error(Fault::usage, text("splat trains on one capture, not ", scenes.size()));
  const Scene& scene = scenes.front();
  seed_ = seed;
  cameras_ = camera_region(scene);
  up_ = scene.up;
  metric_ = scene.metric;
  has_alpha_ = scene.has_alpha;
  frames_ = static_cast<int64_t>(frames_of(scene, Split::train).size());
  growth_ = make_growth(config_.growth, cameras_);
  // A capture that comes from a run folder has no files: the gaussians come with the checkpoint.
  const bool restored = scene.root.empty();
  InitialGaussians first = {{{0, 0, 0}, {0, 0, 0}, {1, 0, 0, 0}, {0}, {0, 0, 0}, std::vector<float>(45)}};
  if (!restored) first = initial_gaussians(scene, {config_.initial, config_.initial_random, seed});
  put(first.gaussians);
  grey_ = first.grey;
  if (config_.exposure)
    params_["exposure"] = parameter(std::vector<float>(static_cast<size_t>(6 * frames_), 0), {frames_, 6});
}

std::vector<std::string> Splat::warnings(const Scene& scene) const {
  if (config_.initial != "auto" || scene.cloud.count() > 0 || !scene.sweeps.empty()) return {};
  return {
      "no points: Gaussians start at random positions in the region that the cameras see; a COLMAP model with points "
      "gives a better start (cloam process PHOTOS -o DATA makes one)"};
}

void Splat::put(const Gaussians& gaussians) {
  const auto count = static_cast<int64_t>(gaussians.count());
  for (const Part& part : parts()) params_[part.name] = parameter(gaussians.*part.values, shape_of(part, count));
  gradient_sums_ = zeros({count});
  views_ = zeros({count});
}

void Splat::fit_to(const TensorMap& parameters) {
  const auto found = parameters.find("opacities");
  if (found == parameters.end() || found->second.shape.size() != 1) return;
  for (const Part& part : parts())
    params_[part.name] =
        parameter(std::vector<float>(static_cast<size_t>(numel(shape_of(part, found->second.shape[0])))),
                  shape_of(part, found->second.shape[0]));
  gradient_sums_ = zeros({found->second.shape[0]});
  views_ = zeros({found->second.shape[0]});
}

Gaussians Splat::gaussians() const {
  Gaussians out;
  for (const Part& part : parts()) out.*part.values = params_.at(part.name).to_host();
  out.up = up_;
  out.metric = metric_;
  return out;
}

void Splat::load_data(std::vector<TrainingData> data) {
  const Pixels pixels = undistorted(data.front().pixels);
  for (const FramePixels& f : pixels.frames) {
    Photograph one;
    one.rgba = planar(f.rgba, 4, f.height, f.width);
    if (!f.mask.empty()) one.mask = from_host(f.mask, {f.height, f.width});
    one.camera = pixels.cameras[static_cast<size_t>(f.camera)];
    one.world_from_camera = data.front().scene.frames[f.frame].world_from_camera;
    photographs_.push_back(std::move(one));
  }
  if (photographs_.empty()) throw Error(Fault::data, "no training image is left");
  if (grey_) take_colours(pixels);
}

void Splat::take_colours(const Pixels& pixels) {
  std::vector<PosedPhoto> photos;
  for (size_t i = 0; i < photographs_.size(); i++)
    photos.push_back({pixels.frames[i], photographs_[i].camera, photographs_[i].world_from_camera});
  Gaussians coloured = gaussians();
  colour_from(photos, coloured);
  put(coloured);
}

MemoryPlan Splat::memory(const PhotoSizes& photos) const {
  constexpr uint64_t kNumbers = 4 * 59;                         // bytes of a gaussian's parameters
  constexpr uint64_t kWork = 4 * 170 + 10 * 100, kPixel = 160;  // gradients, projections, ten pairs with tiles
  const auto most = static_cast<uint64_t>(std::max<int64_t>(count(), config_.growth.most));
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

SplatModel Splat::model(int degree) const {
  return {{params_.at("means"), params_.at("scales"), params_.at("rotations"), params_.at("opacities")},
          {params_.at("sh_first"), params_.at("sh_rest"), degree}};
}

DrawOptions Splat::draw_options() const {
  return {config_.near * static_cast<float>(cameras_.radius), config_.antialiased};
}

/// A degree more each time; in a short training the last one shall still be learned for most of it.
int Splat::degree_at(const Progress& progress) const {
  int64_t every = config_.sh_every;
  if (progress.horizon > 0) every = std::min(every, std::max<int64_t>(1, progress.horizon / 10));
  return static_cast<int>(std::min<int64_t>(config_.sh_degree, progress.step / std::max<int64_t>(1, every)));
}

/// Every image once before any comes again.
size_t Splat::photograph_for(const Progress& progress) const {
  const auto count = static_cast<int64_t>(photographs_.size()), place = progress.step - 1;
  const std::vector<float> keys =
      random_uniform({count}, {seed_, static_cast<uint32_t>(place / count), kOrder}).to_host();
  std::vector<size_t> order(static_cast<size_t>(count));
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return keys[a] < keys[b]; });
  return order[static_cast<size_t>(place % count)];
}

/// [3,1,1]
Tensor Splat::background_for(const Progress& progress) const {
  if (config_.background == "random")
    return random_uniform({3, 1, 1}, {seed_, static_cast<uint32_t>(progress.step), kBackground});
  return full({3, 1, 1}, config_.background == "white" || (config_.background == "auto" && has_alpha_) ? 1.f : 0.f);
}

Tensor Splat::exposed(const Tensor& planes, size_t photograph) const {
  if (!config_.exposure) return planes;
  const Tensor& all = params_.at("exposure");
  const auto row = static_cast<int64_t>(photograph);
  const Tensor own = slice(all, 0, row, row + 1) - mean(all, {{0}, true});
  return planes * exp(reshape(slice(own, 1, 0, 3), {3, 1, 1})) + reshape(slice(own, 1, 3, 6), {3, 1, 1});
}

Tensor Splat::loss(const Progress& progress) {
  const size_t which = photograph_for(progress);
  const Photograph& photograph = photographs_[which];
  degree_ = degree_at(progress);
  DrawOptions options = draw_options();
  probe_ = config_.growth.absolute ? parameter(std::vector<float>(static_cast<size_t>(2 * count())), {count(), 2})
                                   : Tensor();
  options.probe = probe_;
  last_ = draw(model(degree_), photograph.camera, view_matrix(photograph.world_from_camera), options);
  const Tensor background = background_for(progress);
  const Tensor drawn = exposed(last_.planes + unsqueeze(last_.transmittance, 0) * background, which);
  const Tensor rgba = cast(photograph.rgba, DType::f32) / 255.f;
  Tensor truth = slice(rgba, 0, 0, 3), picture = drawn;
  if (has_alpha_) {
    const Tensor alpha = slice(rgba, 0, 3, 4);
    truth = truth * alpha + background * (1.f - alpha);
  }
  if (photograph.mask) {
    const Tensor used = unsqueeze(cast(photograph.mask, DType::f32) / 255.f, 0);
    truth = truth * used;
    picture = picture * used;
  }
  error_ = mean(square(picture - truth));
  const Likeness alike = likeness(picture, truth);
  const Tensor loss = (1.f - config_.ssim) * alike.l1 + config_.ssim * (1.f - alike.ssim);
  const Tensor penalty = growth_->penalty(model(degree_).cloud);
  return penalty ? loss + penalty : loss;
}

Step Splat::step(const Progress& progress, const Tensors& wanted) {
  Tensors all = wanted;
  const Tensor total = loss(progress);
  all.push_back(probe_ ? probe_ : last_.seen);
  Step step = step_of(total, all);
  mean_gradient_ = step.gradients.back() ? stop_gradient(step.gradients.back()) : Tensor();
  step.gradients.pop_back();
  observe();
  step.figures = {psnr_figure(error_), {"gaussians", static_cast<double>(count())}};
  step.more = {gradient_sums_, views_};
  return step;
}

/// Sums for the growth: |d loss / d mean|, in units of half the picture, of the gaussians that some tile lists.
void Splat::observe() {
  const int64_t count = last_.seen.dim(0);
  const Tensor listed =
      cast(slice(last_.tiles.first, 0, 1, count + 1) > slice(last_.tiles.first, 0, 0, count), DType::f32);
  if (!mean_gradient_) mean_gradient_ = zeros({count, 2});
  const Tensor half = from_host(
      std::vector<float>{0.5f * static_cast<float>(last_.tiles.width), 0.5f * static_cast<float>(last_.tiles.height)},
      {1, 2});
  const Tensor length = sqrt(sum(square(slice(mean_gradient_, 1, 0, 2) * half), {{1}}));
  gradient_sums_ = gradient_sums_ + length;
  views_ = views_ + listed;
}

RowMoves Splat::grow(const Progress& progress) {
  const ParameterGroup means = group_of("means", groups());
  const Tensor shift = growth_->shift(model(degree_).cloud, progress, means.rate * means.schedule.at(progress));
  if (shift) assign({{params_.at("means"), params_.at("means") + shift}});
  if (!growth_->due(progress)) return {};
  Gaussians all = gaussians();
  GrowthStatistics statistics;
  const std::vector<float> sums = gradient_sums_.to_host(), views = views_.to_host();
  for (size_t i = 0; i < sums.size(); i++) statistics.gradients.push_back(sums[i] / std::max(1.f, views[i]));
  const GrowthMoves moves = growth_->grow(all, statistics, progress);
  if (all.count() == 0)
    throw Error(Fault::diverged,
                text("no Gaussian is left after step ", progress.step,
                     "\n  fix: --set growth.prune_opacity=0.001, or lower rates; are the poses right?"));
  if (!moves.any()) return {};
  put(all);
  last_ = {};
  RowMoves out;
  for (const Part& part : parts()) out.push_back({part.name, moves.source});
  if (moves.opacities_reset)
    for (RowMove& move : out)
      if (move.name == "opacities") std::fill(move.source.begin(), move.source.end(), -1);
  return out;
}

Picture Splat::render(const View& view) {
  const Camera pinhole = pinhole_around(view.camera);
  DrawOptions options = draw_options();
  options.depth = true;
  const Drawn drawn = draw(model(config_.sh_degree), pinhole, view_matrix(view.world_from_camera), options);
  const float back = config_.background == "white" || (config_.background == "auto" && has_alpha_) ? 1.f : 0.f;
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

TensorMap Splat::state() const { return {{"gradient_sums", named(gradient_sums_)}, {"views", named(views_)}}; }

void Splat::restore(const TensorMap& state) {
  gradient_sums_ = tensor_from(state, "gradient_sums", {count()});
  views_ = tensor_from(state, "views", {count()});
}

}  // namespace cloam
