// See neurad_model.h.
#include "models/methods/neurad_model.h"

#include <algorithm>
#include <cmath>

#include "models/street/followed_rays.h"
#include "runtime/error.h"
#include "runtime/ops/composite.h"
#include "runtime/ops/segments.h"
#include "runtime/ops/volume.h"

namespace cloam {
namespace {

constexpr float kLeastThrough = 1e-3f;
constexpr float kEmbeddingStart = 0.1f;
constexpr int64_t kMostMoments = 1000;  // embeddings a sensor

// Streams of random numbers within a step.
enum NeuradStream : uint32_t { kShifts = 0, kFlips = 1, kShiftsOfShares = 1024 };

/// The contraction of kernels/street.cl at points [S,3] of its cube: how far out they lie (1: the edge of the middle)
/// and how much a small ball shrinks there against the middle, as the cube root of its volume.
struct Contraction {
  Tensor distance, shrink;
};
Contraction contraction_at(const Tensor& points) {
  const Tensor folded = maximum(max(abs(points * 4.f - 2.f), {{1}}), 1.f);
  const Tensor distance = 1.f / maximum(2.f - folded, 1e-3f);
  // |dx'/dx| along the ray from the middle is 1 / d^2, across it (2 - 1/d) / d, twice.
  return {distance, pow(2.f * distance - 1.f, 2.f / 3.f) / square(distance)};
}

std::vector<std::string> sensors_of(const Scene& scene) {
  std::vector<std::string> names;
  for (const Frame& frame : scene.frames)
    if (std::find(names.begin(), names.end(), frame.sensor) == names.end()) names.push_back(frame.sensor);
  names.push_back(kLidarName);
  return names;
}

}  // namespace

float pixel_angle(double focal, int scale) { return static_cast<float>(std::pow(scale / focal, 2)); }

NeuradModel::NeuradModel(const NeuradOptions& options, const Scope& root, const Scene& scene)
    : options_(options), scene_(scene), space_(std::make_unique<StreetSpace>(scene, options.space)) {
  options_.image.features = options_.field.network.features + options_.appearance;
  field_ = std::make_unique<NeuradField>(root / "background", root / "actors", root / "field", options_.field,
                                         static_cast<int64_t>(scene.actors.size()));
  image_ = std::make_unique<ImageDecoder>(root / "image", options_.image);
  const int64_t width = options_.lidar_width;
  lidar_ = std::make_unique<SmallMlp>(root / "lidar",
                                      std::vector<int64_t>{options_.image.features + 1, width, width, width, 2});
  sensors_ = sensors_of(scene);
  double last = first_ = scene.frames.front().timestamp.value_or(0);
  for (const Frame& frame : scene.frames) {
    first_ = std::min(first_, frame.timestamp.value_or(0));
    last = std::max(last, frame.timestamp.value_or(0));
  }
  const double seconds = std::ceil((last - first_) * static_cast<double>(options_.appearance_rate));
  moments_ = std::clamp<int64_t>(static_cast<int64_t>(seconds) + 1, 1, kMostMoments);
  if (options_.appearance > 0)
    embeddings_ = root.uniform("appearance", {static_cast<int64_t>(sensors_.size()) * moments_, options_.appearance},
                               kEmbeddingStart);
}

/// One scale for all three axes: the contraction keeps shapes, and the grid's cells are cubes.
StreetGrid NeuradModel::grid() const {
  StreetGrid grid = space_->grid();
  std::vector<float> numbers = grid.numbers.to_host();
  const float half = *std::max_element(numbers.begin() + 10, numbers.begin() + 13);
  std::fill(numbers.begin() + 10, numbers.begin() + 13, half);
  grid.numbers = from_host(numbers, grid.numbers.shape());
  return grid;
}

NeuradScene NeuradModel::street(const RayList& rays) const {
  const std::shared_ptr<const Scene> scene = scene_.get();
  NeuradScene out{boxes_of(scene->actors, rays, *space_), grid(), {}, {}};
  for (std::size_t i = 0; i < scene->actors.size(); ++i) {
    const Actor& actor = scene->actors[i];
    out.looks.push_back(static_cast<int32_t>(actor.asset ? place_of(*actor.asset) : i));
    out.shrink.push_back(cube_scale(actor.size));
  }
  return out;
}

NeuradScene NeuradModel::alone(std::size_t actor) const {
  const Eigen::Vector3d size = scene_.get()->actors.at(actor).size;
  return {single_box(size), sky_of(grid()), {static_cast<int32_t>(actor)}, {cube_scale(size)}};
}

std::size_t NeuradModel::place_of(const AssetName& asset) const {
  const std::shared_ptr<const Scene> scene = scene_.get();
  for (std::size_t i = 0; asset.scene == 0 && i < scene->actors.size(); ++i)
    if (scene->actors[i].id == asset.actor_id) return i;
  throw Error(Fault::data, text("there is no actor ", asset.actor_id, " in log ", asset.scene, " of this run"));
}

/// Metres that each sample is wide, [S] by row: the standard deviation of a ball as large as the piece of the ray's
/// cone between it and the next sample.
Tensor NeuradModel::widths_of(const StreetSamples& s, const Tensor& angles) const {
  const int64_t all = s.t.dim(0), background = s.points.dim(0);
  const Tensor steps = where(s.rows < Tensor(static_cast<int32_t>(background)), Tensor(options_.steps.background),
                             Tensor(options_.steps.actor));
  const Tensor area = segment_spread(angles, s.offsets, all) * square(s.t);
  const Tensor by_place = pow(area * steps * 0.5f, 1.f / 3.f);
  return gather_rows(by_place, sort(s.rows).order);
}

FieldPoints NeuradModel::background_points(const StreetSamples& s, const Tensor& metres) const {
  const std::vector<float> numbers = space_->grid().numbers.to_host();
  const float half = *std::max_element(numbers.begin() + 10, numbers.begin() + 13);
  return {s.points, metres * contraction_at(s.points).shrink * (0.25f / half), {}};
}

FieldPoints NeuradModel::actor_points(const NeuradScene& scene, const StreetSamples& s, const Tensor& metres) const {
  const auto count = static_cast<int64_t>(scene.looks.size());
  return {s.actor_points, metres * gather_rows(from_host(scene.shrink, {count}), s.owners),
          gather_rows(from_host(scene.looks, {count}), s.owners)};
}

Tensor NeuradModel::encoded(const NeuradScene& scene, const StreetSamples& s, const Tensor& angles) const {
  const Tensor metres = stop_gradient(widths_of(s, angles));
  const int64_t background = s.points.dim(0), all = s.t.dim(0);
  const FieldPoints actors =
      all > background ? actor_points(scene, s, slice(metres, 0, background, all)) : FieldPoints();
  return field_->encoded(background_points(s, slice(metres, 0, 0, background)), actors);
}

NeuradRays NeuradModel::render(const NeuradScene& scene, const RayList& rays, const Tensor& angles,
                               const NeuradSampling& how) const {
  const int64_t count = rays.count();
  const RandomKey jitter = how.key.of_stream(how.share == 0 ? kShifts : kShiftsOfShares + how.share);
  const bool follows = static_cast<bool>(how.rays.origins);
  const StreetRays at = {follows ? how.rays.origins : from_host(rays.origins, {count, 3}),
                         follows ? how.rays.directions : from_host(rays.directions, {count, 3}),
                         how.random ? random_uniform({count, 2}, jitter) : full({count, 2}, 0.5f),
                         from_host(rays.moments, {count})};
  const StreetField& network = field_->network();
  NeuradRays out;
  out.samples = street_samples(at, scene.boxes, scene.grid, options_.steps);
  out.marched = out.samples.t.dim(0);
  mirror(out.samples, scene, how);
  eval({out.samples.actor_points, out.samples.actor_directions});
  const Tensor all = network.geometry(encoded(scene, out.samples, angles)).distance;
  out.samples = street_lit(out.samples, stop_gradient(network.opacity(all)), kLeastThrough);
  if (follows || how.moves_boxes) {
    out.samples =
        follows ? followed(out.samples, at, scene.boxes, scene.grid) : followed_in_boxes(out.samples, at, scene.boxes);
    mirror(out.samples, scene, how);
  }
  const StreetSamples& s = out.samples;
  Tensor harmonics = gather_rows(spherical_harmonics(at.directions), s.ray);
  if (s.owners.dim(0) > 0) harmonics = concat({harmonics, spherical_harmonics(s.actor_directions)}, 0);
  const StreetField::Geometry geometry = network.geometry(encoded(scene, s, angles));
  out.alpha = network.opacity(geometry.distance);
  const int64_t wide = options_.field.network.features;
  const Contents seen = {network.features(geometry.inner, harmonics), s.t, from_host(rays.ranges, {count}),
                         options_.near, s.points.dim(0)};
  const Tensor blended = composite({out.alpha, s.offsets, {}, s.rows, true}, seen);
  const auto sum_of = [&](int64_t which) { return reshape(slice(blended, 1, which, which + 1), {count}); };
  out.features = slice(blended, 1, 0, wide);
  out.opacity = sum_of(wide);
  out.depth = sum_of(wide + 1);
  out.line_of_sight = sum_of(wide + 3);
  out.actor_opacity = sum_of(wide + 4);
  return out;
}

/// Some actors of a step are seen in a mirror, left for right: most are alike on both sides (NeuRAD, section 4.1).
void NeuradModel::mirror(StreetSamples& samples, const NeuradScene& scene, const NeuradSampling& how) const {
  if (!how.random || options_.flip <= 0 || samples.owners.dim(0) == 0) return;
  const auto count = static_cast<int64_t>(scene.looks.size());
  const Tensor turned = cast(random_uniform({count}, how.key.of_stream(kFlips)) < options_.flip, DType::f32);
  const Tensor across = from_host(std::vector<float>{1, 0, 0}, {1, 3});
  const Tensor is = unsqueeze(gather_rows(turned, samples.owners), 1) * across;
  samples.actor_points = samples.actor_points + is * (1.f - 2.f * samples.actor_points);
  samples.actor_directions = samples.actor_directions * (1.f - 2.f * is);
}

Tensor NeuradModel::embedding_shares(const std::vector<std::pair<std::string, double>>& sensors) const {
  const std::size_t width = sensors_.size() * static_cast<std::size_t>(moments_);
  std::vector<float> shares(sensors.size() * width);
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    const auto& [name, time] = sensors[i];
    const double at = std::clamp((time - first_) * static_cast<double>(options_.appearance_rate), 0.0,
                                 static_cast<double>(moments_ - 1));
    const auto before = static_cast<std::size_t>(at),
               after = std::min(before + 1, static_cast<std::size_t>(moments_) - 1);
    const auto share = static_cast<float>(at - static_cast<double>(before));
    const auto known = std::find(sensors_.begin(), sensors_.end(), name);
    const auto cameras = static_cast<float>(sensors_.size() - 1);
    for (std::size_t sensor = 0; sensor < sensors_.size(); ++sensor) {
      const bool is_it = known != sensors_.end() ? sensors_[sensor] == name : sensors_[sensor] != kLidarName;
      if (!is_it) continue;
      const float whole = known != sensors_.end() ? 1.f : 1.f / cameras;
      float* row = &shares[i * width + sensor * static_cast<std::size_t>(moments_)];
      row[before] += whole * (1 - share);
      row[after] += whole * share;
    }
  }
  return from_host(shares, {static_cast<int64_t>(sensors.size()), static_cast<int64_t>(width)});
}

Tensor NeuradModel::image_of(const Tensor& features, const Tensor& shares) const {
  if (!embeddings_) return (*image_)(features);
  const int64_t count = features.dim(0), rows = features.dim(2), columns = features.dim(3), own = options_.appearance;
  const Tensor seen = reshape(matmul(shares, embeddings_), {count, own, 1, 1});
  return (*image_)(concat({features, broadcast_to(seen, {count, own, rows, columns})}, 1));
}

/// Of the features, the embedding and a one, since the network has no biases.
NeuradModel::Returns NeuradModel::returns_of(const Tensor& features, const Tensor& shares) const {
  const int64_t count = features.dim(0);
  Tensors all = {features, ones({count, 1})};
  if (embeddings_) all.insert(all.begin() + 1, matmul(shares, embeddings_));
  const Tensor out = (*lidar_)(concat(all, 1));
  return {sigmoid(reshape(slice(out, 1, 0, 1), {count})), reshape(slice(out, 1, 1, 2), {count})};
}

StreetPainter NeuradModel::painter(const std::function<NeuradScene(const RayList&)>& scene, const Seer& seer) const {
  StreetPainter painter;
  painter.scale = scale();
  const Tensor shares = embedding_shares({{seer.sensor, seer.time}});
  painter.image = [this, shares](const Tensor& features, const Tensor&) { return image_of(features, shares); };
  const bool is_lidar = seer.sensor == kLidarName;
  painter.look = [this, scene, shares, is_lidar, angle = seer.angle](const RayList& rays) {
    const int64_t count = rays.count();
    const NeuradRays seen = render(scene(rays), rays, full({count}, angle), {});
    Tensors all = {seen.features, seen.depth, seen.opacity, seen.actor_opacity, seen.alpha};
    Returns back;
    if (is_lidar) {
      back = returns_of(seen.features, broadcast_to(shares, {count, shares.dim(1)}));
      back.missing = sigmoid(back.missing);
      all.insert(all.end(), {back.intensity, back.missing});
    }
    eval(all);
    const std::vector<int32_t> owners = street_owners(seen.alpha, seen.samples).to_host<int32_t>();
    return SeenByRays{seen.features,      {},     seen.depth,     seen.opacity,
                      seen.actor_opacity, owners, back.intensity, back.missing};
  };
  return painter;
}

AssetSamples NeuradModel::sample_asset(std::size_t actor, const std::vector<float>& points) const {
  const auto count = static_cast<int64_t>(points.size() / 3);
  const StreetField& network = field_->network();
  const float scale = cube_scale(scene_.get()->actors.at(actor).size);
  const Tensor owners = cast(full({count}, static_cast<float>(actor)), DType::i32), widths = zeros({count});
  const auto geometry = [&](const Tensor& at) {
    return network.geometry(field_->encoded({zeros({0, 3}), {}, {}}, {at * scale + 0.5f, widths, owners}));
  };
  const Tensor at = from_host(points, {count, 3});
  const Tensor normal = outward_normals(at, [&](const Tensor& p) { return geometry(p).distance; });
  const StreetField::Geometry here = geometry(at);
  const Tensor feature = network.features(here.inner, spherical_harmonics(-normal));
  // The colour that the image decoder gives to a surface of this feature alone.
  const int64_t side = 3, middle = side * image_->scale() / 2;
  const Tensor map = broadcast_to(reshape(feature, {count, feature.dim(1), 1, 1}), {count, feature.dim(1), side, side});
  const Tensor shares = broadcast_to(embedding_shares({{"", first_}}), {count, embeddings_ ? embeddings_.dim(0) : 1});
  const Tensor image = image_of(map, shares);
  const Tensor colour = reshape(slice(slice(image, 2, middle, middle + 1), 3, middle, middle + 1), {count, 3});
  eval({here.distance, colour});
  return {here.distance.to_host(), colour.to_host()};
}

}  // namespace cloam
