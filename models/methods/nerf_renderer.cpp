// See nerf_renderer.h.
#include "models/methods/nerf_renderer.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "models/batches/own_rows.h"
#include "models/render/picture_pixels.h"
#include "runtime/error.h"
#include "runtime/ops/composite.h"
#include "runtime/ops/volume.h"

namespace cloam {
namespace {

// Streams of random numbers within a step, beside those of the method.
enum RenderStream : uint32_t { kRayJitter = 2, kPlace = 4, kFine = 5, kFinePlace = 6, kCells = 16 };

constexpr size_t kChannels = 6;  // of composite(): colour, opacity, depth, distortion
constexpr float kLeastTransmittance = 1e-3f;
constexpr double kRenderSamples = 400000;  // samples in memory while rendering
constexpr int64_t kRowBlock = 512;         // rays
// From the near plane to infinity NDC have a length of 2, a contracted ray 64. Densities are per 1/32 there, so that an
// untrained field is as opaque: through a thin one photos are too bright, and its colours go to white and stay there.
constexpr float kNdcDensity = 32.f;
constexpr float kMinStep = 1e-5f;  // normalised units: a ray takes 100,000 of them

SceneFrame frame_of(const NerfConfig& config, const Scene& scene) {
  if (config.space == "ndc" || (config.space == "auto" && fits_ndc(scene))) return fit_ndc(scene, config.nearest);
  SceneFrame frame = fit_scene(scene);
  if (config.space == "contract" && !frame.contract)
    throw Error(Fault::usage, "setting space.kind: contract is for captures without a box of their own: use auto");
  return frame;
}

/// Of samples, in [0,1]^3; differentiable where the rays are, as march() is not.
Tensor points_of(const RaySamples& samples, const Rays& path, bool contract) {
  if (!path.directions.tracked()) return samples.points;
  const auto of_ray = [&](const Tensor& rows) { return gather_rows(rows, samples.ray); };
  return unit_points(of_ray(path.origins) + of_ray(path.directions) * unsqueeze(samples.t, 1), contract);
}

}  // namespace

NerfRenderer::NerfRenderer(const NerfConfig& config, const Scene& scene, const Scope& root)
    : config_(config), frame_(frame_of(config, scene)) {
  if (config.min_step > 0 && config.min_step < kMinStep)
    throw Error(Fault::usage, text("setting march.min_step: ", config.min_step, ", want 0 or ", kMinStep, " to 1"));
  field_ = make_field(root / "field", config.field);
  if (marching()) occupancy_ = std::make_unique<OccupancyGrid>(config.occupancy);
  if (config.sampling == "importance") coarse_ = make_field(root / "coarse", config.field);
}

MarchOptions NerfRenderer::march_options() const {
  MarchOptions m;
  m.side = config_.occupancy.side;
  m.contract = frame_.contract;
  m.min_step = config_.min_step > 0 ? config_.min_step : frame_.ndc ? 0.02f : 0.01f;
  m.cone = frame_.contract ? config_.cone : 0.f;
  m.threshold = occupancy_->threshold();
  return m;
}

NerfRenderer::Rendered NerfRenderer::shade(const Rays& rays, const Sampling& how) const {
  const Rays path = frame_.ndc ? ndc_rays(rays, frame_) : rays;
  if (marching()) return shade_marched(rays, path, how);
  return coarse_ ? shade_importance(rays, path, how) : shade_uniform(rays, path, how);
}

/// Of samples [S] at t along the paths of the rays `ray` [S]. A mean of lengths in NDC would be one of disparities,
/// which a little haze before a camera draws close to it.
Tensor NerfRenderer::depths(const Rays& rays, const Tensor& t, const Tensor& ray, bool distances) const {
  if (!frame_.ndc || !distances) return t;
  return ndc_distances({gather_rows(rays.origins, ray), gather_rows(rays.directions, ray), Tensor()}, frame_, t);
}

/// Densities of the field, in normalised units or in those of NDC.
Tensor NerfRenderer::per_length(const Tensor& sigma) const { return frame_.ndc ? sigma * kNdcDensity : sigma; }

/// [count,numbers]: the rays' own part of what is drawn for the whole batch.
Tensor NerfRenderer::random_of(int64_t count, int64_t numbers, const Sampling& how, uint32_t stream) {
  return own_rows(random_uniform({how.all > 0 ? how.all : count, numbers}, how.key.of_stream(stream)), how.share);
}

NerfRenderer::Rendered NerfRenderer::shade_marched(const Rays& rays, const Rays& path, const Sampling& how) const {
  const int64_t count = rays.origins.dim(0);
  const Tensor shift = how.jitter ? reshape(random_of(count, 1, how, kRayJitter), {count}) : full({count}, 0.5f);
  MarchOptions steps = march_options();
  steps.explore = how.jitter ? static_cast<int>(how.key.step) : 0;
  const RaySamples all = march(path, shift, occupancy_->values(), steps);
  const RaySamples s =
      how.skim ? visible(all, stop_gradient(per_length(field_->density(all.points))), kLeastTransmittance) : all;
  const FieldOutput out = (*field_)(points_of(s, path, frame_.contract), rays.directions, s.ray);
  const Tensor depth = depths(rays, s.t, s.ray, how.distances);
  const Medium medium{per_length(out.sigma), s.offsets, s.dt};
  const Along along{depths(rays, s.t, s.ray, true), s.ray, composite_weights(medium)};
  return {composite(medium, {out.rgb, depth}), Tensor(), along, s.t.dim(0), all.t.dim(0)};
}

/// One sample in each interval, at its place in it (NeRF eq. 2), composited.
NerfRenderer::Rendered NerfRenderer::shade_edges(const Field& field, const Rays& rays, const Rays& path,
                                                 const Edges& at) const {
  const auto& [edges, place, distances] = at;
  const int64_t count = edges.dim(0), n = edges.dim(1) - 1;
  const Tensor begin = slice(edges, 1, 0, n), length = slice(edges, 1, 1, n + 1) - begin;
  const Tensor t = begin + place * length;
  const Tensor points = unsqueeze(path.origins, 1) + unsqueeze(path.directions, 1) * unsqueeze(t, 2);
  std::vector<int32_t> first, ray;
  for (int64_t r = 0; r <= count; r++) first.push_back(static_cast<int32_t>(r * n));
  for (int64_t r = 0; r < count; r++) ray.insert(ray.end(), static_cast<size_t>(n), static_cast<int32_t>(r));
  const Tensor of_ray = from_host(ray, {count * n});
  const FieldOutput out = field(unit_points(reshape(points, {count * n, 3}), frame_.contract), rays.directions, of_ray);
  const Medium medium{per_length(out.sigma), from_host(first, {count + 1}), reshape(length, {count * n})};
  const Tensor depth = depths(rays, reshape(t, {count * n}), of_ray, distances);
  const Along along{depths(rays, reshape(t, {count * n}), of_ray, true), of_ray, composite_weights(medium)};
  return {composite(medium, {out.rgb, depth}), Tensor(), along, count * n, count * n};
}

/// [R,N+1]: the ends of `samples.coarse` intervals of one length a ray.
Tensor NerfRenderer::even_edges(const Rays& path) const {
  const int64_t count = config_.coarse_samples;
  std::vector<float> steps;
  for (int64_t i = 0; i <= count; i++) steps.push_back(static_cast<float>(i) / static_cast<float>(count));
  const Tensor near = slice(path.span, 1, 0, 1), far = maximum(slice(path.span, 1, 1, 2), near + 1e-3f);
  return near + (far - near) * from_host(steps, {1, count + 1});
}

/// Where in [0,1) of `numbers` intervals a ray's samples lie.
Tensor NerfRenderer::places(const Rays& rays, int64_t numbers, const Sampling& how, uint32_t stream) {
  const int64_t count = rays.origins.dim(0);
  return how.jitter ? random_of(count, numbers, how, stream) : full({count, numbers}, 0.5f);
}

NerfRenderer::Rendered NerfRenderer::shade_uniform(const Rays& rays, const Rays& path, const Sampling& how) const {
  return shade_edges(*field_, rays, path,
                     {even_edges(path), places(rays, config_.coarse_samples, how, kPlace), how.distances});
}

NerfRenderer::Rendered NerfRenderer::shade_importance(const Rays& rays, const Rays& path, const Sampling& how) const {
  const int64_t count = rays.origins.dim(0), coarse = config_.coarse_samples, fine = config_.fine_samples;
  const Tensor edges = even_edges(path);
  const Rendered first = shade_edges(*coarse_, rays, path, {edges, places(rays, coarse, how, kPlace), how.distances});
  std::vector<float> ranks;
  for (int64_t i = 0; i < fine; i++) ranks.push_back(static_cast<float>(i));
  const Tensor even = (from_host(ranks, {1, fine}) + places(rays, fine, how, kFine)) * (1.f / static_cast<float>(fine));
  const Tensor all = importance_edges(edges, reshape(first.along.weight, {count, coarse}), even);
  Rendered out = shade_edges(*field_, rays, path, {all, places(rays, coarse + fine, how, kFinePlace), how.distances});
  out.coarse = first.fine;
  out.samples = out.marched = count * samples_per_ray();
  return out;
}

int64_t NerfRenderer::samples_per_ray() const {
  return coarse_ ? int64_t{2} * config_.coarse_samples + config_.fine_samples : config_.coarse_samples;
}

/// Density times the local step over the smallest one: what decides whether a cell can be seen. Far cells of a
/// contracted scene are crossed in long steps, so that a thin medium counts there. At [S,3] in [0,1]^3.
Tensor NerfRenderer::thickness(const Tensor& points) const {
  const Tensor sigma = per_length(field_->density(points));
  if (!frame_.contract) return sigma;
  const MarchOptions m = march_options();
  const Tensor folded = max(abs(points * 4.f - 2.f), {{1}});
  const Tensor distance = 1.f / maximum(2.f - maximum(folded, 1.f), 1e-2f);
  return sigma * maximum(distance * (m.cone / m.min_step), 1.f);
}

DensityField NerfRenderer::density_field() const {
  if (frame_.ndc)
    throw Error(Fault::usage,
                "a run in NDC has no mesh: its space ends at no distance\n  fix: train with --set space.kind=contract");
  const auto cells = std::make_shared<OccupiedCells>(marching() ? occupancy_->occupied() : OccupiedCells());
  const auto places = [this](const std::vector<float>& world) {
    return unit_points(from_host(normalised(world, frame_), {static_cast<int64_t>(world.size() / 3), 3}),
                       frame_.contract);
  };
  DensityField out;
  out.subject = box_of(frame_);
  out.densities = [this, cells, places](const std::vector<float>& points) {
    const Tensor unit = places(points), sigma = field_->density(unit) * static_cast<float>(frame_.scale);
    eval({unit, sigma});
    std::vector<float> densities = sigma.to_host();
    cells->clear_empty(unit.to_host(), densities);
    return densities;
  };
  out.colours = [this, places](const std::vector<float>& points, const std::vector<float>& directions) {
    const auto count = static_cast<int64_t>(points.size() / 3);
    std::vector<int32_t> own(points.size() / 3);
    std::iota(own.begin(), own.end(), 0);
    return (*field_)(places(points), from_host(directions, {count, 3}), from_host(own, {count})).rgb.to_host();
  };
  out.is_empty = [this, cells](const Eigen::AlignedBox3d& box) {
    const double side = frame_.contract ? 4 : 2;  // of what [0,1]^3 is
    const auto unit = [&](const Eigen::Vector3d& at) -> Eigen::Vector3d {
      return ((at - frame_.centre) * frame_.scale / side).array() + 0.5;
    };
    return box_of(frame_).contains(box) && cells->none_in({unit(box.min()), unit(box.max())});
  };
  return out;
}

void NerfRenderer::follow(int64_t step, uint64_t seed) {
  if (!marching()) return;
  const auto density = [this](const Tensor& points) { return thickness(points); };
  // The first steps rehearse the update, so that none of the later ones has to compile kernels.
  if (step <= 2) occupancy_->rehearse(density, {seed, 0, kCells});
  const bool due = step >= config_.occupancy_start && (step - config_.occupancy_start) % config_.occupancy_every == 0;
  if (due) occupancy_->update(density, {seed, static_cast<uint32_t>(step), kCells});
}

void NerfRenderer::restore(const TensorMap& state) {
  if (marching()) occupancy_->restore(state);
}

Picture NerfRenderer::picture(const View& view, float back) const {
  const Rays all = view_rays(view, frame_, {});
  const int64_t count = all.directions.dim(0);
  Picture out;
  out.width = view.camera.width;
  out.height = view.camera.height;
  int64_t block = marching() ? 2048 : 512;
  for (int64_t begin = 0; begin < count;) {
    if (begin > 0) view.between();
    const int64_t end = std::min(count, begin + block);
    const auto part = [&](const Tensor& x) { return slice(x, 0, begin, end); };
    const Rays rays{part(all.origins), part(all.directions), part(all.span)};
    Sampling how;
    how.distances = true;
    const Rendered seen = shade(rays, how);
    append_pixels(out, seen.fine.to_host(), {kChannels, back, frame_.scale});
    // The next block is as large as keeps the samples at hand within kRenderSamples.
    const double per_ray = static_cast<double>(seen.marched + 1) / static_cast<double>(end - begin);
    block = std::clamp<int64_t>(static_cast<int64_t>(kRenderSamples / per_ray), 256, 2 * block);
    begin = end;
  }
  return out;
}

std::vector<RaySample> NerfRenderer::samples(const View& view, int row) const {
  const Rays all = view_rays(view, frame_, {});
  const int64_t width = view.camera.width, begin = row * width;
  std::vector<RaySample> out;
  for (int64_t column = 0; column < width; column += kRowBlock) {
    const int64_t end = std::min(width, column + kRowBlock);
    const auto part = [&](const Tensor& x) { return slice(x, 0, begin + column, begin + end); };
    Sampling how;
    how.distances = true;
    const Along along = shade({part(all.origins), part(all.directions), part(all.span)}, how).along;
    eval({along.distance, along.ray, along.weight});
    const std::vector<float> distances = along.distance.to_host(), weights = along.weight.to_host();
    const std::vector<int32_t> rays = along.ray.to_host<int32_t>();
    for (size_t i = 0; i < rays.size(); i++)
      out.push_back({static_cast<int>(column) + rays[i], distances[i] / static_cast<float>(frame_.scale), weights[i]});
  }
  return out;
}

}  // namespace cloam
