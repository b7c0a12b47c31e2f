// NeuRAD: settings, batches, losses.
#include "models/methods/neurad.h"

#include <algorithm>
#include <cmath>

#include "models/io/host_random.h"
#include "models/io/in_parallel.h"
#include "models/street/least_errors.h"
#include "models/street/street_sweeps.h"
#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr size_t kSweepsOfMissing = 4;  // a step
constexpr int64_t kLookAhead = 8;       // steps whose images are decoded ahead
constexpr int64_t kSamplesOfRay = 60;   // of a ray, as a rule

void bind_grid(Config& c, const std::string& of, HashGrid& grid, const std::string& whose) {
  c.bind(of + ".levels", grid.levels, "levels of " + whose + " hash grid", {1, 32});
  c.bind(of + ".features", grid.features, "features a level of " + whose + " hash grid", {1, 4});
  c.bind(of + ".log2_rows", grid.log2_rows, "log2 of the rows a level of " + whose + " hash grid", {4, 24});
  c.bind(of + ".coarsest", grid.coarsest, "cells per axis of its coarsest level", {1, 65536});
  c.bind(of + ".finest", grid.finest, "cells per axis of its finest level", {1, 65536});
}

}  // namespace

void Neurad::configure(Config& c) {
  NeuradConfig& o = config_;
  NeuradOptions& street = o.street;
  bind_grid(c, "grid", street.field.background, "the background's");
  bind_grid(c, "actors", street.field.actors, "each actor's");
  c.bind("actors.flip", street.flip, "how often a step sees an actor mirrored, left for right", {0, 1});
  c.bind("field.downweight", street.field.downweight, "levels finer than a sample is wide count less");
  c.bind("field.width", street.field.network.width, "width of both field networks", {1, 4096});
  c.bind("field.features", street.field.network.features, "numbers of a sample's feature", {4, 128});
  c.bind("field.distance_layers", street.field.network.distance_layers, "hidden layers of the signed distance network",
         {1, 64});
  c.bind("field.feature_layers", street.field.network.feature_layers, "hidden layers of the feature network", {1, 64});
  c.bind("field.sharpness", street.field.network.sharpness, "initial beta of the opacity function");
  c.bind("beyond.field_bypass", street.field.network.bypass, "a linear path past the field's first network");
  c.bind("image.width", street.image.width, "channels of the image decoder", {1, 4096});
  c.bind("image.kernel", street.image.side, "kernel size of the image decoder's convolutions", {1, 31});
  c.bind("image.blocks", street.image.blocks, "residual blocks of the image decoder", {0, 64});
  c.bind("image.upsamplings", street.image.doublings, "number of times the image decoder doubles the resolution",
         {0, 5});
  c.bind("appearance.size", street.appearance, "numbers of a sensor's embedding; 0: none", {0, 1024});
  c.bind("appearance.rate", street.appearance_rate, "embeddings per second, linear in between", {0, 1000});
  c.bind("sensors.rolling_shutter", o.rolling_shutter,
         "see each row of an image when it was exposed (meta/recording.json: rolling_shutter_seconds)");
  c.bind("steps.background", street.steps.background, "metres between samples in occupied voxels", kMetres);
  c.bind("steps.actor", street.steps.actor, "metres between samples in actors", kMetres);
  c.bind("steps.sky", street.steps.sky, "samples per ray in the sky", {1, 4096});
  c.bind("space.voxel", street.space.voxel, "voxel size of the LiDAR occupancy grid, in metres", kMetres);
  c.bind("space.dilate", street.space.dilate, "voxels by which occupied regions are dilated", {0, 64});
  c.bind("batch.patches", o.patches, "image patches per step", {1, 4096});
  c.bind("batch.patch_side", o.patch_side, "rays per side of a patch", {1, 4096});
  c.bind("batch.lidar_rays", o.lidar_rays, "LiDAR returns per step", {0, 1 << 24});
  c.bind("weight.rgb", o.weight_rgb, "weight of the squared colour error");
  c.bind("weight.perceptual", o.weight_perceptual, "weight of the perceptual loss");
  c.bind("weight.lidar", o.weight_lidar, "weight of the absolute LiDAR depth error, in metres");
  c.bind("weight.line_of_sight", o.weight_line_of_sight,
         "weight of the line-of-sight loss: opacity along LiDAR rays away from their return");
  c.bind("weight.intensity", o.weight_intensity, "weight of the squared error of LiDAR intensities");
  c.bind("weight.ray_drop", o.weight_drop,
         "weight of the cross-entropy of which LiDAR rays come back; 0: none are missing");
  c.bind("lidar.width", street.lidar_width, "width of the network of intensities and missing rays", {1, 4096});
  c.bind("perceptual.weights", o.perceptual_weights,
         "file with weights of a pretrained network; empty: random features");
  c.bind(kMixedPrecision, street.image.half,
         "the image decoder keeps what its convolutions read in half precision: true with --precision mixed");
  c.bind("train.rate_grids", o.rate_grids, "learning rate of the hash grids");
  c.bind("train.rate_field", o.rate_field, "learning rate of the field's networks");
  c.bind("train.rate_image", o.rate_image, "learning rate of the image decoder");
  c.bind("train.rate_appearance", o.rate_appearance, "learning rate of the sensors' embeddings");
  c.bind("train.final_rate", o.final_rate, "learning rates at the last step, as a fraction of the initial ones");
  c.bind("train.warm_up", o.warm_up, "steps in which the learning rates rise", {0, 1 << 20});
  c.bind("train.warm_up_image", o.warm_up_image, "the same of the image decoder's", {0, 1 << 20});
  bind_boxes(c, o.boxes);
  bind_cameras(c, o.cameras);
}

void Neurad::build(const Scenes& scenes, uint64_t seed) {
  if (scenes.size() != 1) throw Error(Fault::usage, text("neurad trains on one log, not ", scenes.size()));
  const Scene& scene = scenes.front();
  if (!scene.is_log) throw Error(Fault::data, "neurad learns driving logs; for photos, use train nerf");
  seed_ = seed;
  model_ = std::make_unique<NeuradModel>(config_.street, Scope{params_, "", seed}, scene);
  if (config_.weight_perceptual > 0) perceptual_ = feature_network(config_.perceptual_weights);
  boxes_.build(config_.boxes, scene, params_);
  cameras_.build(config_.cameras, scene, model_->space().street_from_world(), params_);
}

TensorMap Neurad::state() const {
  TensorMap out = model_->space().state();
  boxes_.add_state(out);
  return out;
}

void Neurad::restore(const TensorMap& state) {
  model_->space().restore(state);
  boxes_.restore(state);
}

void Neurad::load_data(std::vector<TrainingData> data) {
  TrainingData& log = data.front();
  model_->take(log.scene);
  LogSweeps sweeps = training_sweeps(log.scene, model_->space(), log.photos.store());
  find_missing(*log.scene.get(), sweeps);
  data_ = std::make_unique<LogSource>(
      log.scene, std::move(log.photos), std::move(sweeps),
      LogRays{model_->space().street_from_world(), model_->scale(), {}, config_.rolling_shutter});
  loaded(1, 1);
}

/// As large a share of a step's LiDAR rays is missing as of a sweep's.
void Neurad::find_missing(const Scene& scene, const LogSweeps& sweeps) {
  if (config_.weight_drop <= 0) return;
  missing_.resize(sweeps.size());
  in_parallel(sweeps.size(),
              [&](size_t i) { missing_[i] = missing_rays(scene.recording, sweeps.sweep(i), *sweeps.points(i), 0); });
  double returns = 0, missing = 0;
  for (size_t i = 0; i < sweeps.size(); ++i) {
    returns += static_cast<double>(sweeps.returns(i));
    missing += static_cast<double>(missing_[i].origins.size() / 3);
  }
  std::erase_if(missing_, [](const WorldRays& rays) { return rays.origins.empty(); });
  if (returns > 0) missing_rays_ = std::llround(missing / returns * config_.lidar_rays);
}

void Neurad::add_missing(RayList& rays, HostRandom& random, const Share& share) const {
  const Eigen::Matrix4d& street = model_->space().street_from_world();
  const auto parts = static_cast<int64_t>(std::min<size_t>(kSweepsOfMissing, missing_.size()));
  for (int64_t part = 0; part < parts; ++part) {
    const WorldRays& sweep = missing_[random.below(missing_.size())];
    const size_t first = rays.times.size();
    rays.times.push_back(sweep.time);
    for (int64_t i = part; i < missing_rays_; i += parts) {
      const size_t at = random.below(sweep.origins.size() / 3);
      if (!share.holds(i, missing_rays_)) continue;
      const auto vector_of = [&](const std::vector<float>& values) {
        return Eigen::Map<const Eigen::Vector3f>(&values[3 * at]).cast<double>().eval();
      };
      rays.add((street * vector_of(sweep.origins).homogeneous()).head<3>(),
               street.topLeftCorner<3, 3>() * vector_of(sweep.directions));
      rays.last_is_at(sweep.times.empty() ? sweep.time : sweep.times[at], first);
    }
  }
}

MemoryPlan Neurad::memory(const PhotoSizes&) const {
  MemoryPlan plan = memory_of(params_);
  const NeuradOptions& street = config_.street;
  const int64_t cells = int64_t{config_.patches} * config_.patch_side * config_.patch_side,
                rays = cells + config_.lidar_rays, scale = model_->scale();
  const int64_t encoded = int64_t{street.field.background.levels} * street.field.background.features;
  const int64_t a_sample =
      4 * (6 * encoded + 8 * int64_t{street.field.network.width} + 4 * int64_t{street.field.network.features} + 64);
  const int64_t a_pixel = 4 * int64_t{street.image.width} * (6 + (street.image.half ? 3 : 4) * street.image.blocks);
  plan.work =
      plan.parameters + static_cast<uint64_t>(rays * kSamplesOfRay * a_sample + cells * scale * scale * a_pixel);
  return plan;
}

ParameterGroups Neurad::groups() const {
  const NeuradConfig& c = config_;
  const LearningRateSchedule schedule = {c.final_rate, 0, 0, c.warm_up};
  ParameterGroups groups = {{"background.", c.rate_grids, schedule},
                            {"field.", c.rate_field, schedule},
                            {"image.", c.rate_image, {c.final_rate, 0, 0, c.warm_up_image}},
                            {"lidar.", c.rate_field, schedule},
                            {"appearance", c.rate_appearance, schedule}};
  for (ParameterGroup& group : groups) group.epsilon = 1e-15f;
  // Rows of actors that no ray of a step meets stand still: Adam's momentum would move them on.
  groups.push_back({"actors.", c.rate_grids, schedule});
  groups.back().sparse = true;
  boxes_.add_groups(groups);
  cameras_.learned().add_groups(groups);
  return groups;
}

/// What a step sees.
struct Neurad::Batch {
  RayList rays;
  Photographed photos;
  int64_t of_photos = 0;   // rays, before those of the LiDAR
  int64_t of_returns = 0;  // and before those that nothing came back along
  Tensor angles;           // [R]
  Tensor shares;           // [N,embeddings] of the photos
};

void Neurad::look_ahead(const Progress& progress) {
  const int64_t now = progress.step;
  data_->photos().begin(now);
  if (announced_ < now || announced_ > now + kLookAhead) announced_ = now;  // the first, or it went back
  while (announced_ < now + kLookAhead) {
    const int64_t step = ++announced_;
    StepAhead ahead{{seed_, static_cast<uint64_t>(step)}, step, progress.share};
    data_->expect_patches(ahead, config_.patches, data_->patch_side(config_.patch_side));
    data_->expect_returns(ahead, config_.lidar_rays);
  }
}

Neurad::Batch Neurad::draw_batch(const Progress& progress) const {
  HostRandom random(seed_, static_cast<uint64_t>(progress.step));
  Batch batch;
  const int64_t side = data_->patch_side(config_.patch_side);
  batch.photos = data_->add_patches(batch.rays, random, config_.patches, side, progress.share);
  batch.of_photos = batch.rays.count();
  batch.rays.actors.clear();  // none costs more than the samples in its box
  data_->add_returns(batch.rays, random, config_.lidar_rays, progress.share);
  batch.of_returns = batch.rays.count();
  add_missing(batch.rays, random, progress.share);
  const std::shared_ptr<const Scene> scene = model_->scene();
  std::vector<float> angles;
  std::vector<std::pair<std::string, double>> sensors;
  for (const PhotoOf& photo : batch.photos.of) {
    const Frame& frame = scene->frames[photo.frame];
    angles.insert(angles.end(), static_cast<size_t>(side * side), pixel_angle(photo.focal, model_->scale()));
    sensors.emplace_back(frame.sensor, frame.timestamp.value_or(0));
  }
  angles.resize(static_cast<size_t>(batch.rays.count()), kBeamAngle);
  batch.angles = from_host(angles, {batch.rays.count()});
  batch.shares = model_->embedding_shares(sensors);
  return batch;
}

void Neurad::move_rays(const Batch& batch, NeuradSampling& how) const {
  if (!cameras_.learned().on() || batch.photos.of.empty()) return;
  const auto each = batch.of_photos / static_cast<int64_t>(batch.photos.of.size());
  std::vector<RaysOfPhoto> photos;
  for (const PhotoOf& of : batch.photos.of) photos.push_back({of.frame, each});
  how.rays = cameras_.moved(batch.rays, photos);
}

NeuradScene Neurad::street(const RayList& rays) const {
  NeuradScene scene = model_->street(rays);
  scene.boxes = boxes_.moved(scene.boxes, model_->scene()->actors, rays.times);
  return scene;
}

Tensor Neurad::image_loss(const Batch& batch, const NeuradRays& seen, Tensor& squared) const {
  const Tensor& truth = batch.photos.truth;
  const int64_t rows = truth.dim(2) / model_->scale(), columns = truth.dim(3) / model_->scale();
  const Tensor map =
      permute(reshape(slice(seen.features, 0, 0, batch.of_photos), {truth.dim(0), rows, columns, seen.features.dim(1)}),
              {0, 3, 1, 2});
  const Tensor image = batch.photos.kept(model_->image_of(map, batch.shares));
  squared = mean(square(image - truth));
  const Tensor loss = squared * config_.weight_rgb;
  return perceptual_ ? loss + perceptual_loss(*perceptual_, image, truth) * config_.weight_perceptual : loss;
}

/// Depths without the worst returns, and what lies in a beam's way.
Tensor Neurad::lidar_loss(const Batch& batch, const NeuradRays& seen, Tensor& metres) const {
  const int64_t begin = batch.of_photos, end = batch.of_returns, count = end - begin;
  const std::vector<float>& all = batch.rays.ranges;
  const Tensor ranges = from_host(std::vector<float>(all.begin() + begin, all.begin() + end), {count});
  const Tensor error = abs(slice(seen.depth, 0, begin, end) - ranges);
  metres = mean(minimum(stop_gradient(error), 1.f));
  return mean_without_worst(error) * config_.weight_lidar +
         mean(slice(seen.line_of_sight, 0, begin, end)) * config_.weight_line_of_sight;
}

/// Intensities of what came back, and whether it did.
Tensor Neurad::returns_loss(const Batch& batch, const NeuradRays& seen, std::vector<Figure>& figures) const {
  const int64_t begin = batch.of_photos, middle = batch.of_returns, end = batch.rays.count();
  std::vector<std::pair<std::string, double>> sensors;
  for (int64_t i = begin; i < end; ++i)
    sensors.emplace_back(kLidarName, batch.rays.times[static_cast<size_t>(batch.rays.moments[static_cast<size_t>(i)])]);
  const NeuradModel::Returns found =
      model_->returns_of(slice(seen.features, 0, begin, end), model_->embedding_shares(sensors));
  const std::vector<float>& recorded = batch.rays.intensities;
  const Tensor truth =
      from_host(std::vector<float>(recorded.begin() + begin, recorded.begin() + middle), {middle - begin});
  const Tensor error = mean(square(slice(found.intensity, 0, 0, middle - begin) - truth));
  figures.push_back({"intensity", 0, sqrt(stop_gradient(error))});
  const Tensor loss = error * config_.weight_intensity;
  if (end == middle) return loss;
  // Cross-entropy with 0 for returns and 1 for missing rays.
  std::vector<float> signs(static_cast<size_t>(middle - begin), 1.f);
  signs.resize(static_cast<size_t>(end - begin), -1.f);
  const Tensor wrong = found.missing * from_host(signs, {end - begin});
  figures.push_back({"drop", 0, mean(cast(stop_gradient(wrong) < 0.f, DType::f32))});
  return loss + mean(softplus(wrong)) * config_.weight_drop;
}

Step Neurad::step(const Progress& progress, const Tensors& wanted) {
  look_ahead(progress);
  const Batch batch = draw_batch(progress);
  NeuradSampling how = {
      {seed_, static_cast<uint32_t>(progress.step), 0}, true, static_cast<uint32_t>(progress.share.rank)};
  move_rays(batch, how);
  how.moves_boxes = boxes_.on();
  const NeuradRays seen = model_->render(street(batch.rays), batch.rays, batch.angles, how);
  Tensor squared, metres;
  Tensor loss = image_loss(batch, seen, squared);
  std::vector<Figure> figures;
  if (batch.of_returns > batch.of_photos)
    loss = loss + lidar_loss(batch, seen, metres) + returns_loss(batch, seen, figures);
  Step step = step_of(boxes_.with_smoothness(loss), wanted);
  const float share = std::max(batch.photos.share, 1e-6f);
  step.figures = {psnr_figure(share < 1 ? squared * (1 / share) : squared)};
  if (metres) step.figures.push_back({"lidar_m", 0, metres});
  step.figures.insert(step.figures.end(), figures.begin(), figures.end());
  for (const Figure& figure : boxes_.figures()) step.figures.push_back(figure);
  for (const Figure& figure : cameras_.learned().figures()) step.figures.push_back(figure);
  step.figures.push_back({"samples", static_cast<double>(seen.samples.t.dim(0) * progress.share.ranks)});
  step.figures.push_back({"marched", static_cast<double>(seen.marched * progress.share.ranks)});
  step.weight = static_cast<double>(progress.share.size(config_.patches)) / config_.patches;
  return step;
}

Picture Neurad::render(const View& view) {
  const auto street = [&](const RayList& rays) { return this->street(rays); };
  const NeuradModel::Seer seer = {view.sensor, view.time, pixel_angle(view.camera.fx, model_->scale())};
  const CameraMotion motion =
      config_.rolling_shutter ? camera_motion(*model_->scene(), view.sensor, view.time) : CameraMotion();
  return street_picture(model_->painter(street, seer), view, model_->space(), motion);
}

LidarReturns Neurad::measure(const WorldRays& rays) {
  const auto street = [&](const RayList& list) { return this->street(list); };
  return street_returns(model_->painter(street, {kLidarName, rays.time, kBeamAngle}), rays, model_->space());
}

Picture Neurad::render_asset(const AssetName& asset, const Camera& camera, const Eigen::Matrix4d& box_from_camera) {
  const NeuradScene scene = model_->alone(model_->place_of(asset));
  const auto alone = [&](const RayList&) { return scene; };
  return asset_picture(model_->painter(alone, {"", 0, pixel_angle(camera.fx, model_->scale())}), camera,
                       box_from_camera);
}

AssetSamples Neurad::sample_asset(const AssetName& asset, const std::vector<float>& points) {
  return model_->sample_asset(model_->place_of(asset), points);
}

void Neurad::take_actors(const Scenes& scenes) {
  Scene edited = *model_->scene();
  edited.actors = scenes.at(0).actors;
  model_->take(std::move(edited));
}

}  // namespace cloam
