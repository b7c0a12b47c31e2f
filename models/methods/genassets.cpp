// GenAssets, stage 1: settings, and what the street's model and its training are asked for.
#include "models/methods/genassets.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "models/data/actor_masks.h"
#include "models/io/host_random.h"
#include "models/io/tensors.h"
#include "models/latents/code_rows.h"
#include "models/scene/box_projection.h"
#include "models/street/street_sweeps.h"
#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr float kQuiet = 0.1f;    // of the background's chance texels, if the networks are another run's
constexpr int64_t kSamples = 40;  // of a street's ray, as a rule

/// Mean over the pixels of a box that the photo has.
double squared_error(const Picture& picture, const ShownImage& photo, const PixelBox& box) {
  double sum = 0, count = 0;
  for (int64_t y = box.top; y < std::min<int64_t>(box.bottom, photo.height); ++y)
    for (int64_t x = box.left; x < std::min<int64_t>(box.right, photo.width); ++x)
      for (int64_t c = 0; c < 3; ++c, ++count) {
        const auto rendered = picture.rgb[static_cast<size_t>((y * picture.width + x) * 3 + c)];
        sum += std::pow(double{rendered} - double{photo.rgb[static_cast<size_t>((y * photo.width + x) * 3 + c)]}, 2);
      }
  return count > 0 ? sum / count : 0;
}

}  // namespace

void GenAssets::configure(Config& c) {
  GenAssetsConfig& o = config_;
  StreetModelOptions& street = o.street;
  c.bind("planes.channels", street.plane_channels, "channels per plane", {1, 1024});
  c.bind("background.side", street.background_side, "texels per side of the background planes", {1, 8192});
  c.bind("code.side", street.code_side, "side of an actor's latent code", {1, 256});
  c.bind("code.channels", street.code_channels, "channels of an actor's latent code", {1, 4096});
  c.bind("code.variational", street.variational, "variational codes (mean and variance) with a KL term");
  c.bind("decoder.use", street.decoder, "decode codes to planes; false: learn each actor's planes directly");
  c.bind("decoder.widths", street.decoder_widths,
         "channels of the decoder's blocks; each block after the first doubles the planes");
  c.bind("decoder.middle", street.decoder_middle, "channels of the decoder's first blocks and attention", {1, 4096});
  c.bind("decoder.groups", street.decoder_groups, "groups of the decoder's group norms", {1, 4096});
  c.bind("field.width", street.field.width, "width of both field networks", {1, 4096});
  c.bind("field.distance_layers", street.field.distance_layers, "hidden layers of the signed distance network",
         {1, 64});
  c.bind("field.feature_layers", street.field.feature_layers, "hidden layers of the feature network", {1, 64});
  c.bind("field.sharpness", street.field.sharpness, "initial beta of the opacity function");
  c.bind("image.width", street.image.width, "channels of the image decoder", {1, 4096});
  c.bind("image.kernel", street.image.side, "kernel size of the image decoder's convolutions", {1, 31});
  c.bind("image.blocks", street.image.blocks, "residual blocks of the image decoder", {0, 64});
  c.bind("image.upsamplings", street.image.doublings, "number of times the image decoder doubles the resolution",
         {0, 5});
  c.bind("steps.background", street.steps.background, "metres between samples in occupied voxels", kMetres);
  c.bind("steps.actor", street.steps.actor, "metres between samples in actors", kMetres);
  c.bind("steps.sky", street.steps.sky, "samples per ray in the sky", {1, 4096});
  c.bind("space.voxel", street.space.voxel, "voxel size of the LiDAR occupancy grid, in metres", kMetres);
  c.bind("space.dilate", street.space.dilate, "voxels by which occupied regions are dilated", {0, 64});
  c.bind("actors.symmetric", street.symmetric, "mirror each actor's planes: left and right sides are the same");
  c.bind("shadows", street.shadows, "actors cast shadows on the ground below their boxes");
  c.bind("batch.whole_images", o.whole_images,
         "train on a whole image per step, computed in tiles, instead of patches");
  c.bind("batch.tile_rays", o.tile_rays, "whole images: rays per tile", {1, 1 << 24});
  c.bind("batch.tile_side", o.tile_side, "whole images: rays per side of a decoded window", {1, 1 << 14});
  c.bind("batch.patches", o.patches, "image patches per step", {1, 4096});
  c.bind("batch.patch_side", o.patch_side, "rays per side of a patch", {1, 4096});
  c.bind("batch.lidar_rays", o.lidar_rays, "LiDAR returns per step", {0, 1 << 24});
  c.bind("batch.objects", o.objects,
         "patches of actors' boxes in the perceptual loss: 0 or 1 a step; whole images: per image", {0, 64});
  c.bind("batch.object_side", o.object_side, "pixels per side to which these patches are resized", {1, 4096});
  c.bind("weight.rgb", o.weight_rgb, "weight of the squared colour error");
  c.bind("weight.perceptual", o.weight_perceptual, "weight of the perceptual loss");
  c.bind("weight.adversarial", o.weight_adversarial, "weight of the adversarial loss; 0: no discriminator");
  c.bind("adversarial.widths", o.discriminator_widths, "channels of the discriminator's blocks");
  c.bind("weight.lidar", o.weight_lidar, "weight of the LiDAR depth error (squared up to one metre, then linear)");
  c.bind("weight.line_of_sight", o.weight_line_of_sight,
         "weight of the line-of-sight loss: opacity along LiDAR rays away from their return");
  c.bind("weight.silhouette", o.weight_silhouette,
         "weight of the silhouette loss: squared difference of actors' opacity and the log's actor masks (truth/)");
  c.bind("weight.kl", o.weight_kl,
         "weight of the codes' KL term (summed over the elements of a code, mean over codes)");
  c.bind("weight.prior", o.prior.weight, "with --prior: norm of the prior's gradient, relative to the other losses");
  c.bind("prior.through_network", o.prior.through_network, "back-propagate the prior through the denoiser");
  c.bind("prior.steps", o.prior.steps, "with --prior and --image: denoising steps before training; 0: none",
         {0, 100000});
  c.bind("prior.guidance", o.prior.guidance, "rendering guidance of each denoising step, in noise levels");
  c.bind("prior.noise", o.prior.noise,
         "standard deviation of the initial noise; 0: start at the mean, 1: a full sample", {0, 1});
  c.bind("prior.start", o.prior.start,
         "codes of one image: found by diffusion, or, to compare with, class-mean or nearest training codes",
         {"diffusion", "class-mean", "nearest"});
  c.bind("perceptual.weights", o.perceptual_weights,
         "file with weights of a pretrained network; empty: random features");
  // What the paper does not have, each with a switch (docs/methods/genassets.md, "Where we differ").
  c.bind("beyond.common_background", street.common_background, "texels of a log by height, added to all of it");
  c.bind("beyond.code_bypass", street.code_bypass, "a linear path from codes to planes past the asset decoder");
  c.bind("beyond.class_places", street.class_places, "class embeddings have a part for each place of the code");
  c.bind("beyond.field_bypass", street.field.bypass, "a linear path from texels past the field's first network");
  c.bind("beyond.detail", street.detail, "with frozen networks, actors have texels of their own beside their codes");
  c.bind("beyond.field_residual", street.field.residual, "the field's second network adds to the first one's output");
  c.bind("beyond.image_bypass", street.image.bypass, "three features go past the image decoder to the image");
  c.bind("beyond.linear_lidar", o.linear_lidar, "LiDAR depth errors count linearly beyond a metre");
  c.bind(kMixedPrecision, street.image.half,
         "the image decoder keeps what its convolutions read in half precision: true with --precision mixed");
  c.bind(kNetworksFrozen, street.frozen, "the networks stand still: true with --networks, else false");
  c.bind("train.rate_codes", o.rate_codes, "learning rate of codes");
  c.bind("train.rate_decoder", o.rate_decoder, "learning rate of the asset decoder");
  c.bind("train.rate_field", o.rate_field, "learning rate of the field's networks");
  c.bind("train.rate_image", o.rate_image, "learning rate of the image decoder");
  c.bind("train.rate_background", o.rate_background, "learning rate of the background planes");
  c.bind("train.final_rate", o.final_rate, "learning rates at the last step, as a fraction of the initial ones");
  c.bind("train.decay_start", o.decay_start, "fraction of the steps before the learning rates decay", kShareBelowOne);
  bind_boxes(c, street.boxes);
  bind_cameras(c, street.cameras);
}

void GenAssets::build(const Scenes& scenes, uint64_t seed) {
  seed_ = seed;
  const Scope root{params_, "", seed};
  model_ = std::make_unique<StreetModel>(config_.street, root, scenes);
  training_ = std::make_unique<GenAssetsTraining>(config_, *model_, root / "networks", seed);
}

void GenAssets::load_data(std::vector<TrainingData> data) {
  int64_t silhouettes = 0;
  for (size_t i = 0; i < data.size(); ++i) {
    StreetLog& log = model_->logs()[i];
    log.scene = std::move(data[i].scene);
    LogSweeps sweeps = training_sweeps(log.scene, *log.space, data[i].photos.store());
    std::vector<Silhouette> shares;
    if (config_.weight_silhouette > 0)
      shares = actor_shares(*log.scene.get(), data[i].photos.listed(), model_->scale());
    silhouettes += std::count_if(shares.begin(), shares.end(), [](const Silhouette& one) { return !one.empty(); });
    log.data = std::make_unique<LogSource>(log.scene, std::move(data[i].photos), std::move(sweeps),
                                           LogRays{log.space->street_from_world(), model_->scale(), std::move(shares)});
    loaded(i + 1, data.size());
  }
  if (config_.weight_silhouette > 0 && silhouettes == 0)
    throw Error(Fault::data,
                "weight.silhouette is above 0, but no training image has an actor mask (LOG/truth/CAMERA/NN_actor.png "
                "and LOG/truth/actors.json, see docs/formats.md)\n  add masks, or set weight.silhouette=0");
  training_->unpack_ahead();
  find_codes();
}

MemoryPlan GenAssets::memory(const PhotoSizes&) const {
  MemoryPlan plan = memory_of(params_);
  const StreetModelOptions& street = config_.street;
  const int64_t window = int64_t{config_.tile_side} + 2 * kHalo, patch = config_.patch_side;
  const int64_t cells = config_.whole_images ? window * window : config_.patches * patch * patch,
                rays =
                    config_.whole_images ? std::max(config_.tile_rays, config_.lidar_rays) : cells + config_.lidar_rays;
  const int64_t texels = 3 * int64_t{street.plane_channels}, scale = model_->scale();
  const int64_t a_sample = 4 * (7 * texels + 18 * int64_t{street.field.width} + street.field.features);
  const int64_t of_block = street.image.half ? 3 : 4;  // two of the four in half precision
  const int64_t a_pixel = 4 * street.image.width * (6 + of_block * int64_t{street.image.blocks});
  plan.work = plan.parameters + static_cast<uint64_t>(rays * kSamples * a_sample + cells * scale * scale * a_pixel);
  return plan;
}

Step GenAssets::step(const Progress& progress, const Tensors& wanted) {
  if (prior_) prior_->begin_step(progress);
  auto [step, codes] = training_->step(progress, wanted);
  if (prior_) {
    prior_->add(step, wanted, codes, progress);
    step.figures.push_back({"prior", static_cast<double>(prior_->weight())});
  }
  return step;
}

void GenAssets::after_step(const Progress& progress) {
  training_->after_step();
  if (prior_) prior_->end_step(progress);
}

void GenAssets::fit_to(const TensorMap& parameters) {
  for (StreetLog& log : model_->logs()) log.boxes.fit_to(parameters);
}

std::vector<Actor> GenAssets::refined_actors(int log) const {
  const StreetLog& street = model_->logs().at(static_cast<size_t>(log));
  return street.boxes.refined(street.scene.get()->actors);
}

std::vector<Eigen::Matrix4d> GenAssets::refined_poses(int log) const {
  return model_->logs().at(static_cast<size_t>(log)).cameras.learned().poses();
}

std::vector<LensChange> GenAssets::lens_changes(int log) const {
  return model_->logs().at(static_cast<size_t>(log)).cameras.learned().lens_changes();
}

TensorMap GenAssets::state() const {
  TensorMap out;
  for (size_t i = 0; i < model_->logs().size(); ++i)
    for (const auto& [name, tensor] : model_->logs()[i].space->state())
      out["log" + std::to_string(i) + "." + name] = tensor;
  for (const StreetLog& log : model_->logs()) log.boxes.add_state(out);
  out["lit"] = named_integers({training_->lit_permille});
  if (prior_)
    for (const auto& [name, tensor] : prior_->state()) out["prior." + name] = tensor;
  return out;
}

void GenAssets::restore(const TensorMap& state) {
  for (size_t i = 0; i < model_->logs().size(); ++i)
    model_->logs()[i].space->restore(with_prefix(state, "log" + std::to_string(i) + "."));
  for (StreetLog& log : model_->logs()) log.boxes.restore(state);
  training_->lit_permille = integers_from(state, "lit", 1).front();
  if (prior_) prior_->restore(with_prefix(state, "prior."));
}

Picture GenAssets::render(const View& view) {
  const StreetLog& log = model_->logs().at(static_cast<size_t>(view.scene));
  return street_picture(model_->painter([&](const RayList& rays) { return model_->street(log, rays); }, true), view,
                        *log.space);
}

LidarReturns GenAssets::measure(const WorldRays& rays) {
  const StreetLog& log = model_->logs().at(static_cast<size_t>(rays.scene));
  return street_returns(model_->painter([&](const RayList& list) { return model_->street(log, list); }, false), rays,
                        *log.space);
}

Picture GenAssets::render_asset(const AssetName& asset, const Camera& camera, const Eigen::Matrix4d& box_from_camera) {
  const RayScene scene = model_->alone(model_->assets().place_of(asset));
  return asset_picture(model_->painter([&](const RayList&) { return scene; }, false), camera, box_from_camera);
}

AssetSamples GenAssets::sample_asset(const AssetName& asset, const std::vector<float>& points) {
  return model_->sample_asset(model_->assets().place_of(asset), points);
}

Mesh GenAssets::surroundings(int log, int resolution) {
  return model_->surroundings(model_->logs().at(static_cast<size_t>(log)), resolution);
}

void GenAssets::take_actors(const Scenes& scenes) {
  for (size_t i = 0; i < scenes.size(); ++i) {
    StreetLog& log = model_->logs().at(i);
    Scene edited = *log.scene.get();
    edited.actors = scenes[i].actors;
    log.scene = std::move(edited);
  }
  model_->assets().find_appearance();
  model_->assets().keep_decoded();
}

std::vector<AssetName> GenAssets::show_assets(const std::vector<NewAsset>& assets) {
  model_->assets().set_generated(assets);
  std::vector<AssetName> names;
  for (size_t i = 0; i < assets.size(); ++i) names.push_back(added_asset(model_->logs().size(), i));
  return names;
}

void GenAssets::adopt_networks(const TensorMap& parameters) {
  std::vector<std::pair<Tensor, Tensor>> updates;
  for (const auto& [name, theirs] : parameters)
    if (name.starts_with(kNetworks) && !name.starts_with("networks.discriminator.") && !params_.contains(name))
      throw Error(Fault::usage,
                  text("--networks: its ", name,
                       " has no place in a run of these settings: leave those of "
                       "the networks as in its run; a run of an earlier version has to be trained again"));
  for (const auto& [name, p] : params_) {
    if (!name.starts_with(kNetworks)) continue;
    const auto theirs = parameters.find(name);
    const std::vector<int64_t> wanted(p.shape().begin(), p.shape().end());
    if (theirs != parameters.end() && theirs->second.shape != wanted)
      throw Error(Fault::usage, text("--networks: its ", name, " does not have the shape ", to_string(p.shape()),
                                     " that these settings need: leave code.side, code.channels, decoder.* and the "
                                     "other network sizes as in its run"));
    updates.push_back({p, tensor_from(parameters, name, p.shape())});
  }
  // Chance tells networks apart that are still to be learned; to these it would be specks where no camera looks.
  for (const StreetLog& log : model_->logs()) updates.push_back({log.background, log.background * kQuiet});
  assign(updates);
}

void GenAssets::adopt_prior(const CodeDenoiser& denoiser) {
  const StreetModelOptions& street = config_.street;
  if (!street.decoder)
    throw Error(Fault::usage,
                "--prior: the run learns its actors' planes directly (decoder.use = false): it has no codes");
  const auto channels = static_cast<int64_t>(denoiser.mean.size());
  if (channels != street.code_channels || denoiser.side != street.code_side)
    throw Error(Fault::usage, text("--prior: it was trained on codes of ", channels, "x", denoiser.side, "x",
                                   denoiser.side, ", the settings say ", street.code_channels, "x", street.code_side,
                                   "x", street.code_side, " (code.channels, code.side)"));
  prior_ = std::make_unique<CodePrior>(denoiser, config_.prior, seed_);
}

/// A street that one image alone tells of begins with the prior: it has seen the sides that the image does not show.
void GenAssets::find_codes() {
  if (!prior_ || model_->logs().size() != 1 || model_->logs().front().data->images() != 1) return;
  const StreetLog& log = model_->logs().front();
  RayList rays;
  HostRandom random(0, 0);
  const Photographed photo = log.data->add_image(rays, random, {0, 1}, {});
  CodeRows codes = {log.assets, {}, {}};
  std::vector<AssetPlace> assets;
  for (size_t a = 0; a < rays.actors.size(); ++a)
    if (rays.actors[a]) {
      codes.rows.push_back(static_cast<int32_t>(a));
      assets.push_back({0, a});
    }
  if (assets.empty()) return;
  codes.condition = model_->assets().condition_of(assets);
  const std::vector<int32_t> actors = codes.rows;
  const auto height = photo.truth.dim(2), width = photo.truth.dim(3);
  const std::vector<float> truth = permute(photo.truth, {0, 2, 3, 1}).to_host();
  prior_->find(std::move(codes), [this, actors, truth, height, width] {
    return errors_at(actors, {truth, height, width});
  });
}

std::vector<double> GenAssets::errors_at(const std::vector<int32_t>& actors, const ShownImage& photo) {
  const std::shared_ptr<const Scene> held = model_->logs().front().scene.get();
  const Scene& scene = *held;
  const Frame& frame = *std::find_if(scene.frames.begin(), scene.frames.end(),
                                     [](const Frame& one) { return one.split == Split::train; });
  const Camera& camera = scene.cameras[static_cast<size_t>(frame.camera)];
  const Picture picture = render(view_of(frame, camera, 0));
  std::vector<double> errors;
  for (const int32_t a : actors) {
    const Actor& actor = scene.actors[static_cast<size_t>(a)];
    const auto box = world_from_box_at(actor, frame.timestamp.value_or(0));
    const auto seen =
        box ? bounds_in_image(camera, frame.world_from_camera.inverse() * *box, actor.size) : std::nullopt;
    errors.push_back(seen ? squared_error(picture, photo, *seen) : 0);
  }
  return errors;
}

}  // namespace cloam
