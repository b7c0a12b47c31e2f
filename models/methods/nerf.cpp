// NeRF, composed of a field, a sampler and the quadrature.
#include "models/methods/nerf.h"

#include <algorithm>
#include <cmath>

#include "models/io/tensors.h"
#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/ops/composite.h"
#include "runtime/ops/volume.h"

namespace cloam {
namespace {

// Streams of random numbers within a step.
enum Stream : uint32_t {
  kPixels = 0,
  kJitter = 2,
  kBackground = 3,
  kPlace = 4,
  kFine = 5,
  kFinePlace = 6,
  kCells = 16
};

constexpr size_t kChannels = 6;  // of composite(): colour, opacity, depth, distortion
constexpr float kLeastTransmittance = 1e-3f;
constexpr double kRenderSamples = 400000;         // samples in memory while rendering
constexpr int64_t kMostRays = int64_t{16} << 22;  // a step, of any batch.rays
constexpr float kLeastStep = 1e-5f;               // normalised units: a ray takes 100,000 of them
constexpr int64_t kAllLit = 1000;
constexpr int kWarmUp = 30;  // steps

RandomKey stream(const RandomKey& key, uint32_t which) { return {key.seed, key.step, which}; }

}  // namespace

void Nerf::configure(Config& c) {
  c.bind("field.kind", config_.field.kind, "radiance field: hash, frequency or triplane");
  c.bind("field.levels", config_.field.levels, "hash grid: levels", {1, 32});
  c.bind("field.features", config_.field.features, "hash grid: features per level (1, 2 or 4)", {1, 4});
  c.bind("field.log2_rows", config_.field.log2_rows, "hash grid: log2 of the table rows per level", {1, 28});
  c.bind("field.coarsest", config_.field.coarsest, "hash grid: cells per axis at the coarsest level", {1, 1 << 16});
  c.bind("field.finest", config_.field.finest, "hash grid: cells per axis at the finest level", {1, 1 << 20});
  c.bind("field.width", config_.field.width, "width of the networks", {1, 4096});
  c.bind("field.depth", config_.field.depth, "frequency encoding: layers", {1, 64});
  c.bind("field.point_frequencies", config_.field.point_frequencies, "frequency encoding: frequencies of the position",
         {0, 32});
  c.bind("field.direction_frequencies", config_.field.direction_frequencies,
         "frequency encoding: frequencies of the direction", {0, 32});
  c.bind("field.plane_channels", config_.field.plane_channels, "tri-plane: channels per plane", {1, 1024});
  c.bind("field.plane_side", config_.field.plane_side, "tri-plane: texels per axis", {2, 8192});
  c.bind("sampling", config_.sampling, "occupancy (march through a grid) or importance (coarse and fine network)");
  c.bind("background", config_.background, "background colour: auto, white, random or none");
  c.bind("batch.rays", config_.batch_rays, "rays per step (occupancy sampling: initially)", {1, 1 << 22});
  c.bind("batch.samples", config_.batch_samples, "occupancy sampling: target samples per step", {1, 1 << 28});
  c.bind("samples.coarse", config_.coarse_samples, "importance sampling: stratified samples per ray", {1, 4096});
  c.bind("samples.fine", config_.fine_samples, "importance sampling: additional samples per ray", {1, 4096});
  c.bind("march.min_step", config_.min_step, "smallest step in normalised units; 0: chosen from the scene", {0, 1});
  c.bind("march.cone", config_.cone, "unbounded scenes: step length divided by distance", {0, 1});
  c.bind("occupancy.side", config_.occupancy.side, "occupancy grid: cells per axis", {2, 512});
  c.bind("occupancy.cells", config_.occupancy.cells_per_update, "occupancy grid: cells visited per update",
         {64, 1 << 27});
  c.bind("occupancy.threshold", config_.occupancy.threshold, "occupancy grid: density below which a cell is empty",
         kFromZero);
  c.bind("occupancy.every", config_.occupancy_every, "occupancy grid: steps between updates", {1, 1 << 30});
  c.bind("occupancy.start", config_.occupancy_start, "occupancy grid: step of the first update", {0, 1 << 30});
  c.bind("train.rate", config_.learning_rate, "learning rate of Adam", kFromZero);
  c.bind("train.final_rate", config_.final_rate, "learning rate at the last step, as a fraction of train.rate",
         kFromZero);
  c.bind("train.decay_start", config_.decay_start, "fraction of the steps before the learning rate decays",
         kShareBelowOne);
  c.bind("train.decay_steps", config_.decay_steps, "steps until the final learning rate; 0: the length of the training",
         {0, 1 << 30});
  c.bind("weight.distortion", config_.distortion, "weight of the distortion loss", kFromZero);
  c.bind("train.loss", config_.loss, "pixel loss: square or charbonnier");
}

void Nerf::build(const Scenes& scenes, uint64_t seed) {
  if (scenes.size() != 1) throw Error(Fault::usage, text("nerf trains on one capture, not ", scenes.size()));
  const Scene& scene = scenes.front();
  if (config_.sampling != "occupancy" && config_.sampling != "importance")
    throw Error(Fault::usage, text("setting sampling: \"", config_.sampling, "\", want occupancy or importance"));
  if (config_.min_step > 0 && config_.min_step < kLeastStep)
    throw Error(Fault::usage, text("setting march.min_step: ", config_.min_step, ", want 0 or ", kLeastStep, " to 1"));
  seed_ = seed;
  frame_ = fit_scene(scene);
  has_alpha_ = scene.has_alpha;
  const Scope root{params_, "", seed};
  field_ = make_field(root / "field", config_.field);
  if (marching())
    occupancy_ = std::make_unique<OccupancyGrid>(config_.occupancy);
  else
    coarse_ = make_field(root / "coarse", config_.field);
  rays_ = config_.batch_rays;
}

void Nerf::load_data(std::vector<TrainingData> data) {
  bank_ = std::make_unique<RayBank>(data.front().scene, data.front().pixels, frame_, range_);
}

MemoryPlan Nerf::memory(const PhotoSizes& photos) const {
  MemoryPlan plan = memory_of(params_);
  plan.images = photos.bytes + 12 * photos.largest;  // and directions
  const int64_t samples = marching()
                              ? config_.batch_samples
                              : int64_t{config_.batch_rays} * (2 * config_.coarse_samples + config_.fine_samples);
  plan.work = 2 * plan.parameters + static_cast<uint64_t>(samples * (field_->bytes_per_sample() + 64));
  return plan;
}

ParameterGroups Nerf::groups() const {
  ParameterGroup all;
  all.rate = config_.learning_rate;
  all.schedule = {config_.final_rate, config_.decay_start, config_.decay_steps, kWarmUp};
  if (config_.field.kind != "frequency") all.beta2 = 0.99f, all.epsilon = 1e-15f;  // Mueller et al. 2022
  return {all};
}

MarchOptions Nerf::march_options() const {
  MarchOptions m;
  m.side = config_.occupancy.side;
  m.contract = frame_.contract;
  m.min_step = config_.min_step > 0 ? config_.min_step : 0.01f;
  m.cone = frame_.contract ? config_.cone : 0.f;
  m.threshold = occupancy_->threshold();
  return m;
}

Nerf::Rendered Nerf::shade(const Rays& rays, const Sampling& how) const {
  return marching() ? shade_marched(rays, how) : shade_importance(rays, how);
}

Nerf::Rendered Nerf::shade_marched(const Rays& rays, const Sampling& how) const {
  const int64_t count = rays.origins.dim(0);
  const Tensor shift = how.jitter ? random_uniform({count}, stream(how.key, kJitter)) : full({count}, 0.5f);
  MarchOptions steps = march_options();
  steps.explore = how.jitter ? static_cast<int>(how.key.step) : 0;
  const RaySamples all = march(rays, shift, occupancy_->values(), steps);
  const RaySamples s = how.skim ? visible(all, stop_gradient(field_->density(all.points)), kLeastTransmittance) : all;
  const FieldOutput out = (*field_)(s.points, rays.directions, s.ray);
  return {composite({out.sigma, s.offsets, s.dt}, {out.rgb, s.t}), Tensor(), s.t.dim(0), all.t.dim(0)};
}

/// One sample in each interval, at `place` [R,N] in [0,1) of it (NeRF eq. 2), composited.
Tensor Nerf::shade_edges(const Field& field, const Rays& rays, const Tensor& edges, const Tensor& place,
                         Tensor* weights) const {
  const int64_t count = edges.dim(0), n = edges.dim(1) - 1;
  const Tensor begin = slice(edges, 1, 0, n), length = slice(edges, 1, 1, n + 1) - begin;
  const Tensor t = begin + place * length;
  const Tensor points = unsqueeze(rays.origins, 1) + unsqueeze(rays.directions, 1) * unsqueeze(t, 2);
  std::vector<int32_t> first, ray;
  for (int64_t r = 0; r <= count; r++) first.push_back(static_cast<int32_t>(r * n));
  for (int64_t r = 0; r < count; r++) ray.insert(ray.end(), static_cast<size_t>(n), static_cast<int32_t>(r));
  const Tensor offsets = from_host(first, {count + 1}), flat_length = reshape(length, {count * n});
  const FieldOutput out = field(unit_points(reshape(points, {count * n, 3}), frame_.contract), rays.directions,
                                from_host(ray, {count * n}));
  if (weights) *weights = reshape(composite_weights({out.sigma, offsets, flat_length}), {count, n});
  return composite({out.sigma, offsets, flat_length}, {out.rgb, reshape(t, {count * n})});
}

Nerf::Rendered Nerf::shade_importance(const Rays& rays, const Sampling& how) const {
  const int64_t count = rays.origins.dim(0), coarse = config_.coarse_samples, fine = config_.fine_samples;
  std::vector<float> steps;
  for (int64_t i = 0; i <= coarse; i++) steps.push_back(static_cast<float>(i) / static_cast<float>(coarse));
  const Tensor near = slice(rays.span, 1, 0, 1), far = maximum(slice(rays.span, 1, 1, 2), near + 1e-3f);
  const Tensor edges = near + (far - near) * from_host(steps, {1, coarse + 1});
  const auto place = [&](int64_t n, uint32_t which) {
    return how.jitter ? random_uniform({count, n}, stream(how.key, which)) : full({count, n}, 0.5f);
  };
  Rendered out;
  Tensor weights;
  out.coarse = shade_edges(*coarse_, rays, edges, place(coarse, kPlace), &weights);
  std::vector<float> ranks;
  for (int64_t i = 0; i < fine; i++) ranks.push_back(static_cast<float>(i));
  const Tensor uniform = (from_host(ranks, {1, fine}) + place(fine, kFine)) * (1.f / static_cast<float>(fine));
  const Tensor all = importance_edges(edges, weights, uniform);
  out.fine = shade_edges(*field_, rays, all, place(coarse + fine, kFinePlace), nullptr);
  out.samples = out.marched = count * (2 * coarse + fine);
  return out;
}

/// [R,3] or [1,3]: what is seen where nothing is. Random colours in training teach the field to be opaque or empty.
Tensor Nerf::background_for(int64_t rays, const RandomKey& key) const {
  const bool random = config_.background == "random" || (config_.background == "auto" && has_alpha_);
  if (random) return random_uniform({rays, 3}, stream(key, kBackground));
  return full({1, 3}, config_.background == "white" ? 1.f : 0.f);
}

Tensor Nerf::pixel_loss(const Tensor& colour, const Tensor& truth, const Tensor& used) const {
  Tensor error = square(colour - truth);
  if (config_.loss == "charbonnier") error = sqrt(error + 1e-6f);
  return used ? mean(error * unsqueeze(used, 1)) : mean(error);
}

Step Nerf::step(const Progress& progress, const Tensors& wanted) {
  const RandomKey key{seed_, static_cast<uint32_t>(progress.step), 0};
  const RayBatch batch = bank_->sample(rays_, stream(key, kPixels));
  // What lies behind a surface gets no light and no gradient. A pass through the density alone finds it, and pays once
  // a quarter of the samples are dark; until then it only looks now and then.
  const bool skim = progress.step <= 3 || lit_permille_ < 750 || progress.step % 16 == 0;
  const Rendered seen = shade(batch.rays, {key, true, skim});
  const Tensor background = background_for(rays_, key);
  const Tensor alpha = slice(batch.rgba, 1, 3, 4);
  const Tensor truth =
      has_alpha_ ? slice(batch.rgba, 1, 0, 3) * alpha + background * (1.f - alpha) : slice(batch.rgba, 1, 0, 3);
  const auto colour = [&](const Tensor& rendered) {
    return slice(rendered, 1, 0, 3) + background * (1.f - slice(rendered, 1, 3, 4));
  };
  const Tensor fine = colour(seen.fine);
  const Tensor error = mean(square(stop_gradient(fine) - truth));
  last_samples_ = seen.samples;
  if (skim) lit_permille_ = kAllLit * (seen.samples + 1) / (seen.marched + 1);
  const Tensor spread = mean(slice(seen.fine, 1, 5, 6)) * config_.distortion;
  Tensor loss = pixel_loss(fine, truth, batch.used) + spread;
  if (seen.coarse) loss = loss + pixel_loss(colour(seen.coarse), truth, batch.used);
  Step step = step_of(loss, wanted);
  step.figures = {
      psnr_figure(error), {"rays", static_cast<double>(rays_)}, {"samples", static_cast<double>(last_samples_)}};
  if (marching()) step.figures.push_back({"lit", static_cast<double>(lit_permille_) / 1000});
  return step;
}

void Nerf::after_step(const Progress& progress) {
  if (!marching()) return;
  // Rays follow the samples they cost, slowly, so that a step keeps its size.
  const double per_ray = static_cast<double>(last_samples_ + 1) / static_cast<double>(rays_);
  const double goal = std::clamp(config_.batch_samples / per_ray, 64.0, 16.0 * config_.batch_rays);
  rays_ = std::max<int64_t>(64, std::llround(0.8 * static_cast<double>(rays_) + 0.2 * goal));
  // The first steps rehearse the update, so that none of the later ones has to compile kernels.
  if (progress.step <= 2)
    occupancy_->rehearse([this](const Tensor& points) { return thickness(points); }, {seed_, 0, kCells});
  const bool due = progress.step >= config_.occupancy_start &&
                   (progress.step - config_.occupancy_start) % config_.occupancy_every == 0;
  if (due)
    occupancy_->update([this](const Tensor& points) { return thickness(points); },
                       {seed_, static_cast<uint32_t>(progress.step), kCells});
}

/// Density times the local step over the smallest one: what decides whether a cell can be seen. Far cells of a
/// contracted scene are crossed in long steps, so that a thin medium counts there. At [S,3] in [0,1]^3.
Tensor Nerf::thickness(const Tensor& points) const {
  const Tensor sigma = field_->density(points);
  if (!frame_.contract) return sigma;
  const MarchOptions m = march_options();
  const Tensor folded = max(abs(points * 4.f - 2.f), {{1}});
  const Tensor distance = 1.f / maximum(2.f - maximum(folded, 1.f), 1e-2f);
  return sigma * maximum(distance * (m.cone / m.min_step), 1.f);
}

Picture Nerf::render(const View& view) {
  const Rays all = view_rays(view, frame_, range_);
  const int64_t count = all.directions.dim(0);
  Picture out;
  out.width = view.camera.width;
  out.height = view.camera.height;
  int64_t block = marching() ? 2048 : 512;
  for (int64_t begin = 0; begin < count;) {
    const int64_t end = std::min(count, begin + block);
    const auto part = [&](const Tensor& x) { return slice(x, 0, begin, end); };
    const Rendered seen =
        shade({part(all.origins), part(all.directions), part(all.span)}, {{seed_, 0, 0}, false, true});
    append_pixels(out, seen.fine.to_host());
    // The next block is as large as keeps the samples at hand within kRenderSamples.
    const double per_ray = static_cast<double>(seen.marched + 1) / static_cast<double>(end - begin);
    block = std::clamp<int64_t>(static_cast<int64_t>(kRenderSamples / per_ray), 256, 2 * block);
    begin = end;
  }
  return out;
}

void Nerf::append_pixels(Picture& picture, const std::vector<float>& values) const {
  const float back = has_alpha_ || config_.background == "white" ? 1.f : 0.f;
  for (size_t i = 0; i + kChannels <= values.size(); i += kChannels) {
    const float opacity = values[i + 3];
    for (size_t c = 0; c < 3; c++) picture.rgb.push_back(std::clamp(values[i + c] + back * (1.f - opacity), 0.f, 1.f));
    picture.opacity.push_back(opacity);
    picture.depth.push_back(opacity > 1e-3f ? values[i + 4] / opacity / static_cast<float>(frame_.scale) : 0.f);
  }
}

TensorMap Nerf::state() const {
  TensorMap out = marching() ? occupancy_->state() : TensorMap{};
  out["rays"] = named_integers({rays_, lit_permille_});
  return out;
}

void Nerf::restore(const TensorMap& state) {
  if (marching()) occupancy_->restore(state);
  const std::vector<int64_t> stored = integers_from(state, "rays", 2);
  if (stored[0] < 1 || stored[0] > kMostRays || stored[1] < 0 || stored[1] > kAllLit)
    throw Error(Fault::data, text("the checkpoint's state.rays is ", stored[0], ", ", stored[1], ", want 1 to ",
                                  kMostRays, " rays and 0 to ", kAllLit, " lit samples of ", kAllLit));
  rays_ = stored[0];
  lit_permille_ = stored[1];
}

}  // namespace cloam
