// GenAssets, stage 1.
#include "models/methods/genassets.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <tuple>

#include "models/scene/asset_class.h"
#include "models/scene/assets.h"
#include "models/train/tensors.h"
#include "runtime/error.h"
#include "runtime/ops/composite.h"
#include "runtime/ops/fields.h"
#include "runtime/ops/street.h"
#include "runtime/ops/volume.h"

namespace cloam {
namespace {

constexpr float kCodeDeviation = 0.05f;                // of codes' means at the start
constexpr float kPadding[] = {0.125f, 0.125f, 0.05f};  // metres added to a box's half sizes (UniSim)
constexpr float kCube = 1.1f;                          // a box's cube over its longest side
constexpr float kShadowSlack = 0.3f;  // metres behind the background at which ground still counts as seen
constexpr float kBright = 4;          // shadows begin as sigmoid(kBright)
constexpr float kLeastTransmittance = 1e-3f;
constexpr int64_t kHeights = 9;  // at which a log's texels have something in common
constexpr float kQuiet = 0.1f;   // of the background's chance texels, if the networks are another run's

Tensor columns(const Tensor& x, int64_t begin, int64_t end) { return slice(x, 1, begin, end); }
Tensor column(const Tensor& x, int64_t at) { return reshape(slice(x, 1, at, at + 1), {x.dim(0)}); }

}  // namespace

void GenAssets::configure(Config& c) {
  c.bind("planes.channels", config_.field.plane_channels, "channels per plane", {1, 1024});
  c.bind("background.side", config_.background_side, "texels per side of the background planes", {1, 8192});
  c.bind("code.side", config_.code_side, "side of an actor's latent code", {1, 256});
  c.bind("code.channels", config_.code_channels, "channels of an actor's latent code", {1, 4096});
  c.bind("code.variational", config_.variational, "variational codes (mean and variance) with a KL term");
  c.bind("decoder.use", config_.decoder, "decode codes to planes; false: learn each actor's planes directly");
  c.bind("decoder.widths", config_.decoder_widths,
         "channels of the decoder's blocks; each block after the first doubles the planes");
  c.bind("decoder.middle", config_.decoder_middle, "channels of the decoder's first blocks and attention", {1, 4096});
  c.bind("decoder.groups", config_.decoder_groups, "groups of the decoder's group norms", {1, 4096});
  c.bind("field.width", config_.field.width, "width of both field networks", {1, 4096});
  c.bind("field.distance_layers", config_.field.distance_layers, "hidden layers of the signed distance network",
         {1, 64});
  c.bind("field.feature_layers", config_.field.feature_layers, "hidden layers of the feature network", {1, 64});
  c.bind("field.sharpness", config_.field.sharpness, "initial beta of the opacity function", kFromZero);
  c.bind("image.width", config_.image.width, "channels of the image decoder", {1, 4096});
  c.bind("image.side", config_.image.side, "kernel size of the image decoder", {1, 31});
  c.bind("image.blocks", config_.image.blocks, "residual blocks of the image decoder", {0, 64});
  c.bind("image.doublings", config_.image.doublings, "times that the image decoder doubles the resolution", {0, 5});
  c.bind("steps.background", config_.steps.background, "metres between samples in occupied voxels", kMetres);
  c.bind("steps.actor", config_.steps.actor, "metres between samples in actors", kMetres);
  c.bind("steps.sky", config_.steps.sky, "samples per ray in the sky", {1, 4096});
  c.bind("space.voxel", config_.space.voxel, "voxel size of the LiDAR occupancy grid, in metres", kMetres);
  c.bind("space.dilate", config_.space.dilate, "voxels by which occupied regions are dilated", {0, 64});
  c.bind("actors.symmetric", config_.symmetric, "mirror each actor's planes: left and right sides are the same");
  c.bind("view.drop", config_.view_drop, "share of the steps in which actors are rendered without a view direction",
         {0, 1});
  c.bind("shadows", config_.shadows, "actors cast shadows on the ground below their boxes");
  c.bind("batch.whole_images", config_.whole_images,
         "train on a whole image per step, computed in tiles, instead of patches");
  c.bind("batch.tile_rays", config_.tile_rays, "whole images: rays per tile", {1, 1 << 24});
  c.bind("batch.tile_side", config_.tile_side, "whole images: rays per side of a decoded window", {1, 1 << 14});
  c.bind("batch.patches", config_.patches, "image patches per step", {1, 4096});
  c.bind("batch.patch_side", config_.patch_side, "rays per side of a patch", {1, 4096});
  c.bind("batch.lidar_rays", config_.lidar_rays, "LiDAR returns per step", {0, 1 << 24});
  c.bind("weight.rgb", config_.weight_rgb, "weight of the squared colour error", kFromZero);
  c.bind("weight.perceptual", config_.weight_perceptual, "weight of the perceptual loss", kFromZero);
  c.bind("weight.adversarial", config_.weight_adversarial, "weight of the adversarial loss; 0: no discriminator",
         kFromZero);
  c.bind("adversarial.widths", config_.discriminator_widths, "channels of the discriminator's blocks");
  c.bind("weight.lidar", config_.weight_lidar, "weight of the LiDAR depth error (squared up to one metre, then linear)",
         kFromZero);
  c.bind("weight.stray", config_.weight_stray, "weight of the opacity along LiDAR rays away from their return",
         kFromZero);
  c.bind("weight.kl", config_.weight_kl, "weight of the codes' KL term (mean over their elements)", kFromZero);
  c.bind("weight.prior", config_.prior.weight,
         "with --prior: norm of the prior's gradient, relative to the other losses", kFromZero);
  c.bind("prior.through_network", config_.prior.through_network, "back-propagate the prior through the denoiser");
  c.bind("prior.steps", config_.prior.steps, "with --prior and --image: denoising steps before training; 0: none",
         {0, 100000});
  c.bind("prior.guidance", config_.prior.guidance, "rendering guidance of each denoising step, in noise levels",
         kFromZero);
  c.bind("prior.noise", config_.prior.noise,
         "standard deviation of the initial noise; 0: start at the mean, 1: a full sample", {0, 1});
  c.bind("perceptual.weights", config_.perceptual_weights,
         "file with weights of a pretrained network; empty: random features");
  c.bind("train.rate_codes", config_.rate_codes, "learning rate of codes", kFromZero);
  c.bind("train.rate_decoder", config_.rate_decoder, "learning rate of the asset decoder", kFromZero);
  c.bind("train.rate_field", config_.rate_field, "learning rate of the field's networks", kFromZero);
  c.bind("train.rate_image", config_.rate_image, "learning rate of the image decoder", kFromZero);
  c.bind("train.rate_background", config_.rate_background, "learning rate of the background planes", kFromZero);
  c.bind("train.decay_background", config_.decay_background, "weight decay of the background planes", kFromZero);
  c.bind("train.final_rate", config_.final_rate, "learning rates at the last step, as a share of the initial ones",
         kFromZero);
  c.bind("train.decay_start", config_.decay_start, "share of the steps before the learning rates decay",
         kShareBelowOne);
}

namespace {

/// Fault::usage for widths that group norms cannot divide.
void check_groups(const std::vector<int64_t>& widths, int64_t middle, int64_t groups) {
  for (const int64_t width : widths)
    if (width % groups != 0)
      throw Error(Fault::usage, text("setting decoder.groups: ", groups, " does not divide decoder.widths ", width));
  if (middle % groups != 0)
    throw Error(Fault::usage, text("setting decoder.groups: ", groups, " does not divide decoder.middle ", middle));
}

}  // namespace

void GenAssets::build(const Scenes& scenes, uint64_t seed) {
  seed_ = seed;
  const Scope root{params_, "", seed}, networks = root / "networks";
  config_.image.features = config_.field.features;
  field_ = std::make_unique<StreetField>(networks / "field", config_.field);
  image_ = std::make_unique<ImageDecoder>(networks / "image", config_.image);
  if (config_.decoder) {
    AssetDecoderOptions o;
    o.latent_channels = config_.code_channels;
    o.side = config_.code_side;
    o.classes = kAssetClassCount;
    o.middle = config_.decoder_middle;
    o.widths = whole_numbers("decoder.widths", config_.decoder_widths);
    check_groups(o.widths, o.middle, config_.decoder_groups);
    o.plane_channels = 3 * config_.field.plane_channels;
    o.groups = config_.decoder_groups;
    decoder_ = std::make_unique<AssetDecoder>(networks / "decoder", o);
  }
  if (config_.shadows)
    shadow_.emplace(networks / "shadow", std::vector<int64_t>{3 * int64_t{config_.field.plane_channels} + 17, 32, 3});
  if (config_.weight_perceptual > 0) perceptual_ = feature_network(config_.perceptual_weights);
  if (config_.weight_adversarial > 0)
    discriminator_.emplace(networks / "discriminator",
                           whole_numbers("adversarial.widths", config_.discriminator_widths));
  for (const Scene& scene : scenes) {
    if (!scene.is_log)
      throw Error(Fault::data, text(scene.root.string(), " is not a driving log (format ", scene.format,
                                    "): genassets needs cameras with time stamps, boxes and LiDAR"));
    logs_.push_back(make_log(scene, root / ("log" + std::to_string(logs_.size()))));
  }
  find_looks();
}

GenAssets::Log GenAssets::make_log(const Scene& scene, const Scope& scope) const {
  Log log;
  log.scene = scene;
  log.space = std::make_shared<StreetSpace>(scene, config_.space);
  const int64_t side = config_.background_side, channels = config_.field.plane_channels;
  log.background = scope.uniform("background", {3 * side * side, channels}, 0.1f);
  log.common_background = scope.constant("common.background", {2 * kHeights, 3 * channels}, 0.f);
  const auto actors = static_cast<int64_t>(scene.actors.size());
  const int64_t code = int64_t{config_.code_channels} * config_.code_side * config_.code_side;
  if (actors > 0 && !config_.decoder) {
    const int64_t texels = planes_side() * planes_side();
    log.assets = scope.uniform("planes", {actors, 3 * texels * channels}, 0.1f);
  } else if (actors > 0) {
    const int64_t numbers = code * (config_.variational ? 2 : 1);
    log.assets = scope.uniform("codes", {actors, numbers}, kCodeDeviation);
    log.common_code = scope.constant("common.code", {1, numbers}, 0.f);
  }
  for (const Actor& actor : scene.actors) log.classes.push_back(asset_class(actor.label));
  return log;
}

GenAssets::AssetPlace GenAssets::place_of(const AssetName& asset) const {
  if (asset.scene >= 0 && static_cast<size_t>(asset.scene) < logs_.size()) {
    const std::vector<Actor>& actors = logs_[static_cast<size_t>(asset.scene)].scene.actors;
    for (size_t i = 0; i < actors.size(); ++i)
      if (actors[i].id == asset.actor_id) return {static_cast<size_t>(asset.scene), i};
  }
  throw Error(Fault::data, text("there is no actor ", asset.actor_id, " in log ", asset.scene, " of this run"));
}

/// Looks of assets that are still to be added (add_asset) are an actor's own until then.
void GenAssets::find_looks() {
  const auto is_here = [&](const AssetName& asset) { return asset.scene < static_cast<int>(logs_.size()); };
  for (size_t l = 0; l < logs_.size(); ++l) {
    logs_[l].looks.clear();
    for (size_t a = 0; a < logs_[l].scene.actors.size(); ++a) {
      const std::optional<AssetName>& asset = logs_[l].scene.actors[a].asset;
      logs_[l].looks.push_back(asset && is_here(*asset) ? place_of(*asset) : AssetPlace{l, a});
    }
  }
}

void GenAssets::load_data(std::vector<TrainingData> data) {
  for (size_t i = 0; i < logs_.size(); ++i) {
    std::vector<StreetData::LoadedSweep> sweeps;
    for (const Sweep& sweep : logs_[i].scene.sweeps)
      if (sweep.split == Split::train) sweeps.push_back({&sweep, load_sweep(data[i].scene, sweep)});
    Log& log = logs_[i];
    log.data = std::make_unique<StreetData>(log.scene, std::move(data[i].pixels), std::move(sweeps), image_->scale());
    log.space->look(log.scene, log.data->seen());
  }
  denoise_image();
}

namespace {

/// scale: GenAssets::cube_scale. Columns of the rotation are rows of its inverse.
StreetBox box_of(const Eigen::Matrix4d& street_from_box, const Eigen::Vector3d& size, float scale, size_t owner) {
  StreetBox box{{}, {}, {}, scale, static_cast<int32_t>(owner)};
  Eigen::Map<Eigen::Matrix3f>(box.box_from_street.data()) = street_from_box.topLeftCorner<3, 3>().cast<float>();
  Eigen::Map<Eigen::Vector3f>(box.centre.data()) = street_from_box.topRightCorner<3, 1>().cast<float>();
  Eigen::Map<Eigen::Vector3f>(box.half_size.data()) = (size / 2).cast<float>() + Eigen::Vector3f(kPadding);
  return box;
}

}  // namespace

float GenAssets::cube_scale(const Eigen::Vector3d& size) {
  return 1.f / (kCube * static_cast<float>(std::max(0.5, size.maxCoeff())));
}

Eigen::Vector3d GenAssets::size_of(const AssetPlace& place) const {
  const Actor& actor = logs_[place.log].scene.actors[place.actor];
  Scenes scenes;
  for (const Log& log : logs_) scenes.push_back(log.scene);
  return size_of_looks(scenes, {static_cast<int>(place.log), actor.id}).value_or(actor.size);
}

GenAssets::Stage GenAssets::street(const Log& log, const RayList& rays) const {
  return {log, boxes_of(log, rays), log.space->grid(), log.looks};
}

/// One asset in its box's axes and nothing around it but the sky of its log.
GenAssets::Stage GenAssets::alone(const Log& log, const AssetPlace& place) const {
  std::vector<float> numbers = log.space->grid().numbers.to_host();
  const Eigen::Vector3d size = size_of(place);
  for (size_t k = 0; k < 3; ++k) numbers[k] = 1e6f, numbers[4 + k] = 1;  // a voxel that no ray meets
  const Tensor nothing = from_host(std::vector<uint8_t>{0}, {1, 1, 1});
  return {log,
          pack_boxes({{box_of(Eigen::Matrix4d::Identity(), size, cube_scale(size), 0)}}),
          {nothing, nothing, from_host(numbers, {16})},
          {place}};
}

/// The boxes of every moment in street axes. Owners are places in scene.actors.
StreetBoxes GenAssets::boxes_of(const Log& log, const RayList& rays) const {
  std::vector<std::vector<StreetBox>> moments;
  for (const double time : rays.times) {
    moments.emplace_back();
    for (size_t a = 0; a < log.scene.actors.size(); ++a) {
      const Actor& actor = log.scene.actors[a];
      if (!rays.actors.empty() && !rays.actors[a]) continue;
      const auto pose = world_from_box_at(actor, time);
      if (!pose) continue;
      moments.back().push_back(box_of(log.space->street_from_world() * *pose, actor.size, cube_scale(actor.size), a));
    }
  }
  return pack_boxes(moments);
}

GenAssets::Shaded GenAssets::shade(const Stage& stage, const RayList& rays, const Drawing& how, bool shadows,
                                   const Decoded* ready) const {
  const Log& log = stage.log;
  const int64_t count = rays.count();
  StreetRays at = {from_host(rays.origins, {count, 3}), from_host(rays.directions, {count, 3}),
                   how.random ? random_uniform({count, 2}, how.of(kJitter)) : full({count, 2}, 0.5f),
                   from_host(rays.moments, {count})};
  StreetSteps steps = config_.steps;
  steps.shadows = shadows && shadow_;
  Shaded out;
  out.samples = street_samples(at, stage.boxes, stage.grid, steps);
  out.marched = out.samples.t.dim(0);
  const Decoded decoded = ready ? *ready : decode_met(meet(stage, out.samples), how);
  const Tensor& slots = decoded.slots;
  out.kl = decoded.kl;
  out.codes = decoded.codes;
  out.actors = decoded.planes ? decoded.planes.dim(1) : 0;
  if (how.skim) {
    const Tensor features = features_at(log, out.samples, decoded.planes, slots);
    const Tensor all = stop_gradient(field_->opacity(field_->geometry(features).distance));
    if (decoded.planes) eval_for_gradient({decoded.planes});
    out.samples = street_lit(out.samples, all, kLeastTransmittance);
  }
  const StreetSamples& s = out.samples;
  Tensor harmonics = gather_rows(spherical_harmonics(at.directions), s.ray);
  if (s.owners.dim(0) > 0) harmonics = concat({harmonics, actor_views(s.actor_directions, how.blind)}, 0);
  const Tensor texels = features_at(log, s, decoded.planes, slots);
  const StreetField::Geometry geometry = field_->geometry(how.apart ? apart(texels, s) : texels);
  out.alpha = field_->opacity(geometry.distance);
  const int64_t wide = config_.field.features;
  const Contents seen = {field_->features(geometry.inner, harmonics), s.t, from_host(rays.ranges, {count}),
                         config_.near, s.points.dim(0)};
  const Tensor blended = composite({out.alpha, s.offsets, {}, s.rows, true}, seen);
  out.features = columns(blended, 0, wide);
  out.opacity = column(blended, wide);
  out.depth = column(blended, wide + 1);
  out.stray = column(blended, wide + 3);
  out.actor_opacity = column(blended, wide + 4);
  if (s.shadow_owners.dim(0) > 0) out.shadow = shadows_of(log, out, decoded.planes, slots);
  return out;
}

/// Spherical harmonics of directions [S,3] in actors' boxes; blind: without all that depends on the direction.
Tensor GenAssets::actor_views(const Tensor& directions, bool blind) {
  const Tensor harmonics = spherical_harmonics(directions);
  if (!blind) return harmonics;
  std::vector<float> first(static_cast<size_t>(harmonics.dim(1)), 0.f);
  first[0] = 1;
  return harmonics * from_host(first, {1, harmonics.dim(1)});
}

/// Where in an actor's planes points of its cube [S,3] are read: of symmetric actors the right half stands for both.
Tensor GenAssets::in_cube(const Tensor& points) const {
  if (!config_.symmetric) return points;
  const Tensor across = from_host(std::vector<float>{1, 0, 0}, {1, 3});
  return points * (1.f - across) + (abs(points - 0.5f) + 0.5f) * across;
}

/// points [S,3] in [0,1]^3 -> [S,2 kHeights]: hat functions of the height for what is near, ramps for the sky. A ramp
/// stays at 1 above its end: what is higher than any camera saw goes on like the highest that one did.
Tensor GenAssets::heights(const Tensor& points) {
  std::vector<float> knots(kHeights);
  for (size_t k = 0; k < knots.size(); ++k) knots[k] = static_cast<float>(k);
  const Tensor above = columns(points, 2, 3) * static_cast<float>(kHeights - 1) - from_host(knots, {1, kHeights});
  const Tensor hats = maximum(1.f - abs(above), 0.f), ramps = minimum(maximum(above + 1.f, 0.f), 1.f);
  // The contracted middle ends at half way from the centre to the border.
  const Tensor far = maximum(max(abs(points - 0.5f), {{1}, true}) * 4.f - 1.f, 0.f);
  return concat({hats * (1.f - far), ramps * far}, 1);
}

/// The features of all samples' planes by row.
Tensor GenAssets::features_at(const Log& log, const StreetSamples& s, const Tensor& planes, const Tensor& slots) const {
  const int64_t side = config_.background_side, channels = config_.field.plane_channels;
  const Tensor background = sample_planes(reshape(log.background, {3, side, side, channels}), s.points) +
                            matmul(heights(s.points), log.common_background);
  if (s.owners.dim(0) == 0) return background;
  return concat({background, sample_planes(planes, in_cube(s.actor_points), gather_rows(slots, s.owners))}, 0);
}

/// What samples read [S,C] by row, but gradients reach the background's on those rays alone that meet no actor.
Tensor GenAssets::apart(const Tensor& texels, const StreetSamples& s) {
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

/// How much light is left on each ray's ground [R,3]: the product over the actors whose shadow may fall there.
Tensor GenAssets::shadows_of(const Log& log, const Shaded& shaded, const Tensor& planes, const Tensor& slots) const {
  const StreetSamples& s = shaded.samples;
  const int64_t places = s.shadow_owners.dim(0);
  const Tensor features = sample_planes(planes, in_cube(s.shadow_points), gather_rows(slots, s.shadow_owners));
  const Tensor night = full({places, 1}, log.scene.night ? 1.f : 0.f);
  const Tensor dark =
      softplus(-((*shadow_)(concat({features, spherical_harmonics(s.shadow_directions), night}, 1)) + kBright));
  const Tensor depth = stop_gradient(gather_rows(shaded.depth, s.shadow_ray));
  const Tensor seen = cast(s.shadow_t <= depth + kShadowSlack, DType::f32) *
                      (1.f - stop_gradient(gather_rows(shaded.actor_opacity, s.shadow_ray)));
  return exp(-segment_sum(dark * unsqueeze(seen, 1), s.shadow_offsets));
}

/// features [N,F,H,W] and shadow [N,3,H,W] (or empty) -> RGB at the image's size.
Tensor GenAssets::image_of(const Tensor& features, const Tensor& shadow) const {
  const Tensor image = (*image_)(features);
  return shadow ? image * resize_bilinear(shadow, image.dim(2), image.dim(3)) : image;
}

TensorMap GenAssets::state() const {
  TensorMap out;
  for (size_t i = 0; i < logs_.size(); ++i)
    for (const auto& [name, tensor] : logs_[i].space->state()) out["log" + std::to_string(i) + "." + name] = tensor;
  out["lit"] = named_integers({lit_permille_});
  if (prior_)
    for (const auto& [name, tensor] : prior_->state()) out["prior." + name] = tensor;
  return out;
}

void GenAssets::adopt_networks(const TensorMap& parameters) {
  std::vector<std::pair<Tensor, Tensor>> updates;
  for (const auto& [name, p] : params_) {
    if (!name.starts_with("networks.")) continue;
    const auto theirs = parameters.find(name);
    const std::vector<int64_t> wanted(p.shape().begin(), p.shape().end());
    if (theirs != parameters.end() && theirs->second.shape != wanted)
      throw Error(Fault::usage, text("--networks: its ", name, " is not ", to_string(p.shape()),
                                     ", as these settings want it: leave code.side, code.channels, decoder.* and all "
                                     "that sizes networks as its run has them"));
    updates.push_back({p, tensor_from(parameters, name, p.shape())});
  }
  // Chance tells networks apart that are still to be learned; to these it would be specks where no camera looks.
  for (const Log& log : logs_) updates.push_back({log.background, log.background * kQuiet});
  assign(updates);
  frozen_ = true;
}

void GenAssets::restore(const TensorMap& state) {
  for (size_t i = 0; i < logs_.size(); ++i)
    logs_[i].space->restore(with_prefix(state, "log" + std::to_string(i) + "."));
  lit_permille_ = integers_from(state, "lit", 1).front();
  if (prior_) prior_->restore(with_prefix(state, "prior."));
}

}  // namespace cloam
