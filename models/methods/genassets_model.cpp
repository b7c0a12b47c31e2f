// See genassets_model.h.
#include "models/methods/genassets_model.h"

#include <Eigen/Geometry>
#include <algorithm>

#include "models/methods/code_set.h"
#include "models/scene/asset_class.h"
#include "models/street/followed_rays.h"
#include "models/train/config.h"
#include "runtime/error.h"
#include "runtime/ops/composite.h"
#include "runtime/ops/sample.h"
#include "runtime/ops/volume.h"

namespace cloam {
namespace {

constexpr float kCodeDeviation = 0.05f;  // of codes' means at the start
constexpr float kShadowSlack = 0.3f;     // metres behind the background at which ground still counts as seen
constexpr float kBright = 4;             // shadows begin as sigmoid(kBright)
constexpr float kMinTransmittance = 1e-3f;
constexpr int64_t kHeights = 9;         // at which a log's texels have something in common
constexpr int64_t kMostKept = 1 << 26;  // numbers of decoded planes

// Streams of random numbers within a step.
enum StreetStream : uint32_t { kJitter = 0, kCodeNoise = 1, kJitterOfShares = 1024 };

Tensor columns(const Tensor& x, int64_t begin, int64_t end) { return slice(x, 1, begin, end); }
Tensor column(const Tensor& x, int64_t at) { return reshape(slice(x, 1, at, at + 1), {x.dim(0)}); }

/// Fault::usage for widths that group norms cannot divide.
void check_groups(const std::vector<int64_t>& widths, int64_t middle, int64_t groups) {
  for (const int64_t width : widths)
    if (width % groups != 0)
      throw Error(Fault::usage, text("setting decoder.groups: ", groups, " does not divide decoder.widths ", width));
  if (middle % groups != 0)
    throw Error(Fault::usage, text("setting decoder.groups: ", groups, " does not divide decoder.middle ", middle));
}

std::unique_ptr<AssetDecoder> make_decoder(const Scope& scope, const StreetModelOptions& options) {
  const AssetDecoderOptions o = {.latent_channels = options.code_channels,
                                 .side = options.code_side,
                                 .classes = kAssetClassCount,
                                 .middle = options.decoder_middle,
                                 .widths = whole_numbers("decoder.widths", options.decoder_widths),
                                 .plane_channels = 3 * options.plane_channels,
                                 .groups = options.decoder_groups,
                                 .class_places = options.class_places,
                                 .bypass = options.code_bypass};
  check_groups(o.widths, o.middle, options.decoder_groups);
  return std::make_unique<AssetDecoder>(scope, o);
}

/// Texels of actors, along each side.
int64_t planes_side(const StreetModelOptions& options) {
  return int64_t{options.code_side} << (whole_numbers("decoder.widths", options.decoder_widths).size() - 1);
}

/// Rows of texels [N, 3 side^2 channels] as planes [3,N,side,side,channels].
Tensor planes_of(const Tensor& texels, const StreetModelOptions& options) {
  const int64_t side = planes_side(options), channels = options.plane_channels;
  return permute(reshape(texels, {texels.dim(0), 3, side, side, channels}), {1, 0, 2, 3, 4});
}

int64_t code_numbers(const StreetModelOptions& options) {
  return int64_t{options.code_channels} * options.code_side * options.code_side;
}

/// Where in an actor's planes points of its cube [S,3] are read: of symmetric actors the right half stands for both.
Tensor in_cube(const Tensor& points, bool symmetric) {
  if (!symmetric) return points;
  const Tensor across = from_host(std::vector<float>{1, 0, 0}, {1, 3});
  return points * (1.f - across) + (abs(points - 0.5f) + 0.5f) * across;
}

/// points [S,3] in [0,1]^3 -> [S,2 kHeights]: hat functions of the height for what is near, ramps for the sky. A ramp
/// stays at 1 above its end: what is higher than any camera saw goes on like the highest that one did.
Tensor height_features(const Tensor& points) {
  std::vector<float> knots(kHeights);
  for (size_t k = 0; k < knots.size(); ++k) knots[k] = static_cast<float>(k);
  const Tensor above = columns(points, 2, 3) * static_cast<float>(kHeights - 1) - from_host(knots, {1, kHeights});
  const Tensor hats = maximum(1.f - abs(above), 0.f), ramps = minimum(maximum(above + 1.f, 0.f), 1.f);
  // The contracted middle ends at half way from the centre to the border.
  const Tensor far = maximum(max(abs(points - 0.5f), {{1}, true}) * 4.f - 1.f, 0.f);
  return concat({hats * (1.f - far), ramps * far}, 1);
}

/// What samples read [S,C] by row, but gradients reach the background's on those rays alone that meet no actor.
Tensor detached_in_boxes(const Tensor& texels, const StreetSamples& s) {
  const std::vector<int32_t> offsets = s.offsets.to_host<int32_t>(), rows = s.rows.to_host<int32_t>();
  const auto background = static_cast<int32_t>(s.points.dim(0));
  std::vector<float> learns(rows.size(), 1.f);
  for (size_t ray = 0; ray + 1 < offsets.size(); ++ray) {
    const auto begin = rows.begin() + offsets[ray], end = rows.begin() + offsets[ray + 1];
    if (std::none_of(begin, end, [&](int32_t row) { return row >= background; })) continue;
    for (auto row = begin; row != end; ++row)
      if (*row < background) learns[static_cast<size_t>(*row)] = 0;
  }
  const Tensor mask = from_host(learns, {texels.dim(0), 1});
  return texels * mask + stop_gradient(texels) * (1.f - mask);
}

HitAssets hits_of(const RayScene& scene, const StreetSamples& s) {
  std::vector<bool> hit(scene.appearance.size());
  for (const Tensor& owners : {s.owners, s.shadow_owners})
    if (owners.dim(0) > 0)
      for (const int32_t owner : owners.to_host<int32_t>()) hit[static_cast<size_t>(owner)] = true;
  return hit_assets(scene.appearance, hit);
}

}  // namespace

HitAssets hit_assets(const std::vector<AssetPlace>& appearance, const std::vector<bool>& hit) {
  HitAssets out;
  out.slot_of.assign(appearance.size() + 1, -1);
  for (size_t owner = 0; owner < appearance.size(); ++owner)
    if (hit[owner]) {
      out.slot_of[owner] = static_cast<int32_t>(out.assets.size());
      out.assets.push_back(appearance[owner]);
    }
  return out;
}

StreetAssets::StreetAssets(const StreetModelOptions& options, const Scope& networks, std::vector<StreetLog>& logs)
    : options_(options), logs_(logs) {
  if (options.decoder) decoder_ = make_decoder(networks / "decoder", options);
}

AssetPlace StreetAssets::place_of(const AssetName& asset) const {
  const auto scene = static_cast<size_t>(asset.scene);
  if (asset.scene >= 0 && scene < logs_.size()) {
    const std::shared_ptr<const Scene> log = logs_[scene].scene.get();
    for (size_t i = 0; i < log->actors.size(); ++i)
      if (log->actors[i].id == asset.actor_id) return {scene, i};
  } else if (asset.scene >= 0 && scene < logs_.size() + generated_.size()) {
    return {logs_.size(), scene - logs_.size()};
  }
  throw Error(Fault::data, text("there is no actor ", asset.actor_id, " in log ", asset.scene, " of this run"));
}

void StreetAssets::find_appearance() {
  const auto is_here = [&](const AssetName& asset) {
    return asset.scene < static_cast<int>(logs_.size() + generated_.size());
  };
  for (size_t l = 0; l < logs_.size(); ++l) {
    const std::shared_ptr<const Scene> scene = logs_[l].scene.get();
    logs_[l].appearance.clear();
    for (size_t a = 0; a < scene->actors.size(); ++a) {
      const std::optional<AssetName>& asset = scene->actors[a].asset;
      logs_[l].appearance.push_back(asset && is_here(*asset) ? place_of(*asset) : AssetPlace{l, a});
    }
  }
}

void StreetAssets::set_generated(const std::vector<NewAsset>& assets) {
  if (!decoder_)
    throw Error(Fault::usage,
                "the run learned its actors' planes directly (decoder.use = false): it cannot decode codes");
  const auto numbers = static_cast<size_t>(code_numbers(options_)), width = numbers * (options_.variational ? 2 : 1);
  std::vector<float> rows;
  for (const NewAsset& asset : assets) {
    if (asset.code.size() != numbers)
      throw Error(Fault::data, text("a code has ", asset.code.size(), " numbers, the run's codes have ", numbers));
    rows.insert(rows.end(), asset.code.begin(), asset.code.end());
    rows.resize(rows.size() + width - numbers);
  }
  generated_ = assets;
  std::erase_if(kept_, [this](const auto& kept) { return kept.first.first == logs_.size(); });
  generated_codes_ =
      assets.empty() ? Tensor() : from_host(rows, {static_cast<int64_t>(assets.size()), static_cast<int64_t>(width)});
  find_appearance();
}

/// Of any actor that has the appearance: the one who had it first may have another's by now.
Eigen::Vector3d StreetAssets::size_of(const AssetPlace& place) const {
  for (const StreetLog& log : logs_)
    for (size_t a = 0; a < log.appearance.size(); ++a)
      if (log.appearance[a] == place) return log.scene.get()->actors[a].size;
  return is_generated(place) ? generated_[place.actor].size : logs_[place.log].scene.get()->actors[place.actor].size;
}

bool StreetAssets::at_night(const AssetPlace& place) const {
  return is_generated(place) ? generated_[place.actor].night : logs_[place.log].night;
}

/// [N, ...]: `rows` of a log's assets, for assets that may be of several logs.
Tensor StreetAssets::rows_of(const std::vector<AssetPlace>& assets,
                             const std::function<Tensor(size_t log, const Tensor& rows)>& rows_in) const {
  Tensors parts;
  for (size_t begin = 0, end = 0; begin < assets.size(); begin = end) {
    const size_t log = assets[begin].log;
    std::vector<int32_t> rows;
    for (; end < assets.size() && assets[end].log == log; ++end)
      rows.push_back(static_cast<int32_t>(assets[end].actor));
    parts.push_back(rows_in(log, from_host(rows, {static_cast<int64_t>(rows.size())})));
  }
  return parts.size() == 1 ? parts.front() : concat(parts, 0);
}

/// The planes with what assets have besides their codes: generated ones nothing.
Tensor StreetAssets::with_detail(const Tensor& planes, const std::vector<AssetPlace>& assets) const {
  const auto detailed = std::find_if(logs_.begin(), logs_.end(), [](const StreetLog& log) { return bool(log.detail); });
  if (detailed == logs_.end()) return planes;
  const int64_t width = detailed->detail.dim(1);
  const Tensor detail = rows_of(assets, [&](size_t log, const Tensor& rows) {
    return log == logs_.size() ? zeros({rows.dim(0), width}) : gather_rows(logs_[log].detail, rows);
  });
  return planes + planes_of(detail, options_);
}

Condition StreetAssets::condition_of(const std::vector<AssetPlace>& assets) const {
  std::vector<int32_t> classes, nights;
  for (const AssetPlace& asset : assets) {
    classes.push_back(is_generated(asset) ? generated_[asset.actor].asset_class
                                          : logs_[asset.log].classes[asset.actor]);
    nights.push_back(at_night(asset) ? 1 : 0);
  }
  return asset_condition(classes, nights);
}

/// One by one where chance has no part: the bits of an asset do not depend on who else is met, and so can be kept.
DecodedAssets StreetAssets::decode(const HitAssets& hits, const Sampling& how) const {
  if (hits.assets.empty() || how.random) return decode_now(hits, how);
  DecodedAssets out;
  out.slots = from_host(hits.slot_of, {static_cast<int64_t>(hits.slot_of.size())});
  Tensors planes;
  for (const AssetPlace& asset : hits.assets) planes.push_back(planes_of_one(asset, how));
  out.planes = planes.size() == 1 ? planes.front() : concat(planes, 1);
  if (static_cast<int64_t>(kept_.size()) * planes.front().numel() > kMostKept) kept_.clear();
  return out;
}

Tensor StreetAssets::planes_of_one(const AssetPlace& asset, const Sampling& how) const {
  const auto known = kept_.find({asset.log, asset.actor});
  if (known != kept_.end()) return known->second;
  const Tensor planes = stop_gradient(decode_now({{0}, {asset}}, how).planes);
  eval({planes});
  if (keeps_) kept_[{asset.log, asset.actor}] = planes;
  return planes;
}

DecodedAssets StreetAssets::decode_now(const HitAssets& hits, const Sampling& how) const {
  if (hits.assets.empty()) return {};
  const auto count = static_cast<int64_t>(hits.assets.size());
  const int64_t side = planes_side(options_), channels = options_.plane_channels;
  const Tensor rows = rows_of(hits.assets, [&](size_t log, const Tensor& at) {
    return gather_rows(log == logs_.size() ? generated_codes_ : logs_[log].assets, at);
  });
  DecodedAssets out;
  out.slots = from_host(hits.slot_of, {static_cast<int64_t>(hits.slot_of.size())});
  if (!decoder_) {
    out.planes = planes_of(rows, options_);
    return out;
  }
  Tensor code = rows, mean_code = rows;
  if (options_.variational) {
    const int64_t numbers = rows.dim(1) / 2;
    const Tensor log_variance = slice(rows, 1, numbers, 2 * numbers) + kCodeLogVariance;
    code = mean_code = slice(rows, 1, 0, numbers);
    if (how.random)
      code = mean_code + exp(log_variance * 0.5f) * random_normal({count, numbers}, how.key.of_stream(kCodeNoise));
    const Tensor terms = square(mean_code) + exp(log_variance) - 1.f - log_variance;
    out.kl = sum(terms) * (0.5f / static_cast<float>(count));
  }
  const Shape shape = {count, options_.code_channels, options_.code_side, options_.code_side};
  const Condition condition = condition_of(hits.assets);
  const Tensor planes = (*decoder_)(reshape(code, shape), condition.labels[0]);
  out.codes = {reshape(mean_code, shape), condition};
  out.planes = with_detail(permute(reshape(planes, {count, 3, channels, side, side}), {1, 0, 3, 4, 2}), hits.assets);
  return out;
}

StreetModel::StreetModel(const StreetModelOptions& options, const Scope& root, const Scenes& scenes)
    : options_(options) {
  const Scope networks = root / "networks";
  options_.image.features = options_.field.features;
  field_ = std::make_unique<StreetField>(networks / "field", 3 * int64_t{options_.plane_channels}, options_.field);
  image_ = std::make_unique<ImageDecoder>(networks / "image", options_.image);
  assets_ = std::make_unique<StreetAssets>(options_, networks, logs_);
  if (options_.shadows)
    shadow_.emplace(networks / "shadow", std::vector<int64_t>{3 * int64_t{options_.plane_channels} + 17, 32, 3});
  for (const Scene& scene : scenes) {
    if (!scene.is_log)
      throw Error(Fault::data, text(scene.root.string(), " is not a driving log (format ", scene.format,
                                    "): genassets needs cameras with time stamps, boxes and LiDAR"));
    logs_.push_back(make_log(scene, root / ("log" + std::to_string(logs_.size()))));
  }
  assets_->find_appearance();
}

StreetLog StreetModel::make_log(const Scene& scene, const Scope& scope) const {
  StreetLog log;
  log.scene = scene;
  log.night = scene.night;
  log.space = std::make_unique<StreetSpace>(scene, options_.space);
  const int64_t side = options_.background_side, channels = options_.plane_channels;
  log.background = scope.uniform("background", {3 * side * side, channels}, 0.1f);
  if (options_.common_background)
    log.common_background = scope.constant("common.background", {2 * kHeights, 3 * channels}, 0.f);
  const auto actors = static_cast<int64_t>(scene.actors.size());
  const int64_t texels = 3 * planes_side(options_) * planes_side(options_) * channels;
  if (actors > 0 && !options_.decoder) {
    log.assets = scope.uniform("planes", {actors, texels}, 0.1f);
  } else if (actors > 0) {
    const int64_t numbers = code_numbers(options_) * (options_.variational ? 2 : 1);
    log.assets = scope.uniform("codes", {actors, numbers}, kCodeDeviation);
    if (options_.frozen && options_.detail) log.detail = scope.constant("detail", {actors, texels}, 0.f);
  }
  for (const Actor& actor : scene.actors) log.classes.push_back(asset_class(actor.label));
  log.boxes.build(options_.boxes, scene, scope.all, scope.path + ".");
  log.cameras.build(options_.cameras, scene, log.space->street_from_world(), scope.all, scope.path + ".");
  return log;
}

RayScene StreetModel::street(const StreetLog& log, const RayList& rays) const {
  const std::shared_ptr<const Scene> scene = log.scene.get();
  const StreetBoxes boxes = log.boxes.moved(boxes_of(scene->actors, rays, *log.space), scene->actors, rays.times);
  return {log, boxes, log.space->grid(), log.appearance};
}

RayScene StreetModel::alone(const AssetPlace& place) const {
  const auto alike = [&](const StreetLog& log) { return log.night == assets_->at_night(place); };
  auto host = place.log < logs_.size() ? logs_.begin() + static_cast<std::ptrdiff_t>(place.log)
                                       : std::find_if(logs_.begin(), logs_.end(), alike);
  if (host == logs_.end()) host = logs_.begin();
  return {*host, single_box(assets_->size_of(place)), sky_of(host->space->grid()), {place}};
}

/// What all samples read of planes, by row.
Tensor StreetModel::texels_of(const StreetLog& log, const StreetSamples& s, const DecodedAssets& assets) const {
  const int64_t side = options_.background_side, channels = options_.plane_channels;
  Tensor background = sample_planes(reshape(log.background, {3, side, side, channels}), s.points);
  if (log.common_background) background = background + matmul(height_features(s.points), log.common_background);
  if (s.owners.dim(0) == 0) return background;
  const Tensor points = in_cube(s.actor_points, options_.symmetric);
  return concat({background, sample_planes(assets.planes, points, gather_rows(assets.slots, s.owners))}, 0);
}

RenderedRays StreetModel::render(const RayScene& scene, const RayList& rays, const Sampling& how, bool shadows,
                                 const DecodedAssets* ready) const {
  const int64_t count = rays.count();
  const RandomKey jitter = how.key.of_stream(how.share == 0 ? kJitter : kJitterOfShares + how.share);
  const bool follows = static_cast<bool>(how.rays.origins);
  const StreetRays at = {follows ? how.rays.origins : from_host(rays.origins, {count, 3}),
                         follows ? how.rays.directions : from_host(rays.directions, {count, 3}),
                         how.random ? random_uniform({count, 2}, jitter) : full({count, 2}, 0.5f),
                         from_host(rays.moments, {count})};
  StreetSteps steps = options_.steps;
  steps.shadows = shadows && shadow_;
  RenderedRays out;
  out.samples = street_samples(at, scene.boxes, scene.grid, steps);
  out.marched = out.samples.t.dim(0);
  out.assets = ready ? *ready : assets_->decode(hits_of(scene, out.samples), how);
  if (how.skip_hidden) {
    const Tensor texels = texels_of(scene.log, out.samples, out.assets);
    const Tensor all = stop_gradient(field_->opacity(field_->geometry(texels).distance));
    if (out.assets.planes) eval_for_gradient({out.assets.planes});
    out.samples = street_lit(out.samples, all, kMinTransmittance);
  }
  if (follows)
    out.samples = followed(out.samples, at, scene.boxes, scene.grid);
  else if (how.moves_boxes)
    out.samples = followed_in_boxes(out.samples, at, scene.boxes);
  const StreetSamples& s = out.samples;
  Tensor harmonics = gather_rows(spherical_harmonics(at.directions), s.ray);
  if (s.owners.dim(0) > 0) harmonics = concat({harmonics, spherical_harmonics(s.actor_directions)}, 0);
  const Tensor texels = texels_of(scene.log, s, out.assets);
  const StreetField::Geometry geometry =
      field_->geometry(how.detach_background ? detached_in_boxes(texels, s) : texels);
  out.alpha = field_->opacity(geometry.distance);
  const int64_t wide = options_.field.features;
  const Contents seen = {field_->features(geometry.inner, harmonics), s.t, from_host(rays.ranges, {count}),
                         options_.near, s.points.dim(0)};
  const Tensor blended = composite({out.alpha, s.offsets, {}, s.rows, true}, seen);
  out.features = columns(blended, 0, wide);
  out.opacity = column(blended, wide);
  out.depth = column(blended, wide + 1);
  out.line_of_sight = column(blended, wide + 3);
  out.actor_opacity = column(blended, wide + 4);
  if (s.shadow_owners.dim(0) > 0) out.shadow = shadow_of(scene.log, out);
  return out;
}

/// How much light is left on each ray's ground [R,3]: the product over the actors whose shadow may fall there.
Tensor StreetModel::shadow_of(const StreetLog& log, const RenderedRays& rendered) const {
  const StreetSamples& s = rendered.samples;
  const int64_t places = s.shadow_owners.dim(0);
  const Tensor texels = sample_planes(rendered.assets.planes, in_cube(s.shadow_points, options_.symmetric),
                                      gather_rows(rendered.assets.slots, s.shadow_owners));
  const Tensor night = full({places, 1}, log.night ? 1.f : 0.f);
  const Tensor dark =
      softplus(-((*shadow_)(concat({texels, spherical_harmonics(s.shadow_directions), night}, 1)) + kBright));
  const Tensor depth = stop_gradient(gather_rows(rendered.depth, s.shadow_ray));
  const Tensor seen = cast(s.shadow_t <= depth + kShadowSlack, DType::f32) *
                      (1.f - stop_gradient(gather_rows(rendered.actor_opacity, s.shadow_ray)));
  return exp(-segment_sum(dark * unsqueeze(seen, 1), s.shadow_offsets));
}

Tensor StreetModel::image_of(const Tensor& features, const Tensor& shadow) const {
  const Tensor image = (*image_)(features);
  return shadow ? image * resize_bilinear(shadow, image.dim(2), image.dim(3)) : image;
}

StreetPainter StreetModel::painter(const std::function<RayScene(const RayList&)>& scene, bool shadows) const {
  StreetPainter painter;
  painter.scale = scale();
  painter.image = [this](const Tensor& features, const Tensor& light) { return image_of(features, light); };
  painter.look = [this, scene, shadows](const RayList& rays) {
    const RenderedRays seen = render(scene(rays), rays, {}, shadows);
    Tensors all = {seen.features, seen.depth, seen.opacity, seen.actor_opacity, seen.alpha};
    if (seen.shadow) all.push_back(seen.shadow);
    eval(all);
    return SeenByRays{seen.features, seen.shadow,        seen.depth,
                      seen.opacity,  seen.actor_opacity, street_owners(seen.alpha, seen.samples).to_host<int32_t>()};
  };
  return painter;
}

AssetSamples StreetModel::sample_asset(const AssetPlace& place, const std::vector<float>& points) const {
  const Tensor planes = stop_gradient(assets_->decode(hit_assets({place}, {true}), {}).planes),
               owners = cast(zeros({static_cast<int64_t>(points.size() / 3)}), DType::i32);
  const float scale = cube_scale(assets_->size_of(place));
  return sample_surface(points, true, [&](const Tensor& at) {
    return sample_planes(planes, in_cube(at * scale + 0.5f, options_.symmetric), owners);
  });
}

Mesh StreetModel::surroundings(const StreetLog& log, int resolution) const {
  StreetSamples samples;
  samples.owners = cast(zeros({0}), DType::i32);
  const auto sample = [&](const std::vector<float>& points, bool coloured) {
    return sample_surface(points, coloured, [&](const Tensor& at) {
      samples.points = contracted(at, log.space->grid());
      return stop_gradient(texels_of(log, samples, {}));
    });
  };
  return static_mesh(*log.space, sample, resolution);
}

/// Points [N,3], without colours where they are not wanted, of a surface that texels at points [N,3] say.
AssetSamples StreetModel::sample_surface(const std::vector<float>& points, bool coloured,
                                         const std::function<Tensor(const Tensor& at)>& texels) const {
  const auto count = static_cast<int64_t>(points.size() / 3);
  const auto geometry = [&](const Tensor& at) { return field_->geometry(texels(at)); };
  const Tensor at = from_host(points, {count, 3});
  if (!coloured) return {geometry(at).distance.to_host(), {}};
  const Tensor normal = outward_normals(at, [&](const Tensor& p) { return geometry(p).distance; });
  const StreetField::Geometry here = geometry(at);
  const Tensor feature = field_->features(here.inner, spherical_harmonics(-normal));
  // The colour that the image decoder gives to a surface of this feature alone.
  const int64_t side = 3, middle = side * image_->scale() / 2;
  const Tensor image = (*image_)(broadcast_to(reshape(feature, {count, options_.field.features, 1, 1}),
                                              {count, options_.field.features, side, side}));
  const Tensor colour = reshape(slice(slice(image, 2, middle, middle + 1), 3, middle, middle + 1), {count, 3});
  eval({here.distance, colour});
  return {here.distance.to_host(), colour.to_host()};
}

}  // namespace cloam
