// See zipnerf_renderer.h.
#include "models/methods/zipnerf_renderer.h"

#include <algorithm>

#include "models/batches/own_rows.h"
#include "models/batches/pixel_targets.h"
#include "models/render/picture_pixels.h"
#include "runtime/error.h"
#include "runtime/ops/composite.h"
#include "runtime/ops/volume.h"

namespace cloam {
namespace {

// Streams of random numbers within a step, beside those of the method: three a level.
enum ZipStream : uint32_t { kRanks = 8, kSpins = 9, kFlips = 10, kStreamsOfLevel = 3 };

constexpr int64_t kNumbers = 5;             // of a ray
constexpr int64_t kPlacesAtOnce = 1 << 18;  // in pictures: places where grids are read
constexpr float kPixelWidth = 1e-3f;        // normalised, where a mesh asks: of 1000 pixels a radian

/// Which ray each of its samples belongs to, and where rays begin: the form of ops on rays of any length.
struct EvenRays {
  Tensor ray, offsets;
};
EvenRays even_rays(int64_t rays, int64_t samples) {
  std::vector<int32_t> ray, offsets;
  for (int64_t r = 0; r <= rays; r++) offsets.push_back(static_cast<int32_t>(r * samples));
  for (int64_t r = 0; r < rays; r++) ray.insert(ray.end(), static_cast<size_t>(samples), static_cast<int32_t>(r));
  return {from_host(ray, {rays * samples}), from_host(offsets, {rays + 1})};
}

/// The share's [R,numbers] of what is drawn for all rays.
Tensor random_of(int64_t numbers, const ZipNerfRenderer::Sampling& how, uint32_t stream) {
  return own_rows(random_uniform({how.all, numbers}, how.key.of_stream(stream)), how.share);
}

/// [R,samples]: even ranks, shifted as a whole for each ray.
Tensor ranks_of(int64_t samples, const ZipNerfRenderer::Sampling& how, uint32_t level) {
  std::vector<float> places;
  for (int64_t i = 0; i < samples; i++) places.push_back(static_cast<float>(i));
  const Tensor shift = how.random ? random_of(1, how, kRanks + kStreamsOfLevel * level) : full({1, 1}, 0.5f);
  return (from_host(places, {1, samples}) + shift) * (1.f / static_cast<float>(samples));
}

void check(const ZipNerfConfig& c) {
  const std::pair<const char*, int> places[] = {{"multisamples", c.multisamples},
                                                {"proposal_multisamples", c.proposal_multisamples}};
  for (const auto& [name, count] : places)
    if (count != 6 && count != 1)
      throw Error(Fault::usage, text("setting sampling.", name, ": ", count, ", want 6 or 1"));
  if (c.pixel_rays != 4 && c.pixel_rays != 1)
    throw Error(Fault::usage, text("setting sampling.pixel_rays: ", c.pixel_rays, ", want 1 or 4"));
}

}  // namespace

ZipNerfRenderer::ZipNerfRenderer(const ZipNerfConfig& config, const Scene& scene, const Scope& root)
    : config_(config), frame_(config.unit == "path" ? fit_path(scene) : fit_scene(scene)) {
  check(config);
  range_.near *= static_cast<float>(frame_.scale / fit_scene(scene).scale);  // things do not come nearer by it
  for (size_t i = 0; i < config.proposals.size(); i++) {
    const ZipNerfConfig::Proposal& p = config.proposals[i];
    const HashGrid grid{p.levels, 1, config.proposal_log2_rows, config.field.grid.coarsest, p.finest};
    const ZipDensity::Options network{config.proposal_width, 1, config.field.density == "exp"};
    proposals_.push_back(std::make_unique<ZipDensity>(root / ("proposal" + std::to_string(i + 1)), grid, network));
  }
  field_ = std::make_unique<ZipField>(root / "field", config.field);
}

WideSamples ZipNerfRenderer::samples_of(const Cones& cones, const Tensor& edges, const Sampling& how,
                                        uint32_t level) const {
  const int64_t pieces = edges.dim(1) - 1, rays = edges.dim(0),
                places = level < proposals_.size() ? config_.proposal_multisamples : config_.multisamples;
  ConeSamples at;
  if (places == 1) {
    at = one_sample(cones, edges);
  } else if (how.random) {
    const Tensor flips = random_of(pieces, how, kFlips + kStreamsOfLevel * level);
    at = six_samples(cones, edges,
                     {random_of(pieces, how, kSpins + kStreamsOfLevel * level), cast(flips < 0.5f, DType::f32)});
  } else {
    at = six_samples(cones, edges, still_turn(pieces));
  }
  at = in_unit_cube(frame_.contract ? contracted(at) : at, frame_.contract);
  const int64_t count = rays * pieces;
  return {reshape(at.points, {count, places, 3}), config_.downweight ? reshape(at.widths, {count, places}) : Tensor()};
}

ZipNerfRenderer::Rendered ZipNerfRenderer::shade(const Cones& cones, const Sampling& how) const {
  const int64_t count = cones.rays.origins.dim(0);
  const RayWarp warp(stop_gradient(cones.rays.span), frame_.contract);  // samples stay where they are along a ray
  const Tensor zero = zeros({count, 1});
  RayHistogram last{concat({zero, zero + 1.f}, 1), zero + 1.f};
  Rendered out;
  for (uint32_t level = 0; level <= proposals_.size(); level++) {
    const bool is_field = level == proposals_.size();
    const int64_t pieces = is_field ? config_.field_samples : config_.proposal_samples;
    const Tensor weights = stop_gradient(last.weights);
    const Tensor edges = resampled_edges({last.edges, pow(maximum(weights, 0.f), how.sharpness)},
                                         ranks_of(pieces, how, level)),
                 t = warp.distances(edges);
    WideSamples at = samples_of(cones, t, how, level);
    if (!is_field) at.points = stop_gradient(at.points);  // poses follow photos, not proposals
    const EvenRays even = even_rays(count, pieces);
    const FieldOutput seen = is_field ? (*field_)(at, cones.rays.directions, even.ray)
                                      : FieldOutput{proposals_[level]->density(proposals_[level]->features(at)), {}};
    const Tensor length = slice(t, 1, 1, pieces + 1) - slice(t, 1, 0, pieces);
    last = {edges,
            reshape(composite_weights({seen.sigma, even.offsets, reshape(length, {count * pieces})}), {count, pieces})};
    out.histograms.push_back(last);
    if (!is_field) continue;
    const Tensor by_sample = unsqueeze(last.weights, 2), middle = slice(t, 1, 0, pieces) + length * 0.5f;
    out.rays = concat({sum(by_sample * reshape(seen.rgb, {count, pieces, 3}), {{1}}), sum(last.weights, {{1}, true}),
                       sum(last.weights * middle, {{1}, true})},
                      1);
    out.middles = middle;
  }
  return out;
}

WideSamples ZipNerfRenderer::places_of(const std::vector<float>& world) const {
  const std::vector<float> at = normalised(world, frame_);
  const auto count = static_cast<int64_t>(at.size() / 3);
  const ConeSamples samples{from_host(at, {1, count, 1, 3}), full({1, count, 1}, kPixelWidth)};
  const ConeSamples unit = in_unit_cube(frame_.contract ? contracted(samples) : samples, frame_.contract);
  return {reshape(unit.points, {count, 1, 3}), config_.downweight ? reshape(unit.widths, {count, 1}) : Tensor()};
}

DensityField ZipNerfRenderer::density_field() const {
  DensityField out;
  out.subject = box_of(frame_);
  out.densities = [this](const std::vector<float>& points) {
    return (field_->density(places_of(points)) * static_cast<float>(frame_.scale)).to_host();
  };
  out.colours = [this](const std::vector<float>& points, const std::vector<float>& directions) {
    const auto count = static_cast<int64_t>(points.size() / 3);
    return (*field_)(places_of(points), from_host(directions, {count, 3}), even_rays(count, 1).ray).rgb.to_host();
  };
  out.is_empty = [](const Eigen::AlignedBox3d&) { return false; };
  return out;
}

Tensor ZipNerfRenderer::interlevel(const Rendered& seen) const {
  Tensor loss;
  for (size_t i = 0; i < proposals_.size(); i++) {
    const Tensor one = interlevel_loss(seen.histograms.back(), seen.histograms[i], config_.proposals[i].pulse);
    loss = loss ? loss + one : one;
  }
  return loss;
}

Tensor ZipNerfRenderer::decay() const {
  Tensor all = field_->grid().decay();
  for (const auto& proposal : proposals_) all = all + proposal->grid().decay();
  return all;
}

int64_t ZipNerfRenderer::bytes_per_ray() const {
  const int64_t places = config_.proposal_multisamples;
  int64_t bytes = config_.field_samples * field_->bytes_per_sample(config_.multisamples);
  for (const auto& proposal : proposals_)
    bytes +=
        4 * config_.proposal_samples * (places * (3 * proposal->grid().numbers() + 8) + 2 * config_.proposal_width);
  return bytes;
}

Picture ZipNerfRenderer::picture(const View& view, float back) const {
  if (config_.pixel_rays == 1) return picture_of_rays(view, back);
  View twice = view;
  twice.camera = resized(view.camera, 2 * view.camera.width, 2 * view.camera.height);
  return halved(picture_of_rays(twice, back));
}

Picture ZipNerfRenderer::picture_of_rays(const View& view, float back) const {
  const Rays all = view_rays(view, frame_, range());
  const std::vector<float> widths = pixel_widths(unit_directions(view.camera), view.camera.width, view.camera.height);
  const int64_t count = all.directions.dim(0);
  const Tensor radii = from_host(widths, {count}) * kConeOfPixel;
  Picture out;
  out.width = view.camera.width;
  out.height = view.camera.height;
  const int64_t places =
      std::max(config_.proposal_multisamples * config_.proposal_samples, config_.multisamples * config_.field_samples);
  const int64_t block = std::max<int64_t>(16, kPlacesAtOnce / places);
  for (int64_t begin = 0; begin < count; begin += block) {
    if (begin > 0) view.between();
    const auto part = [&](const Tensor& x) { return slice(x, 0, begin, std::min(count, begin + block)); };
    const Cones cones{{part(all.origins), part(all.directions), part(all.span)}, part(radii)};
    append_pixels(out, shade(cones, {}).rays.to_host(), {kNumbers, back, frame_.scale});
  }
  return out;
}

}  // namespace cloam
