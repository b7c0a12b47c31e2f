// Street Gaussians: settings, losses and growth. What is drawn is street_gaussians_model.h's.
#include "models/methods/street_gaussians.h"

#include <algorithm>
#include <cmath>

#include "models/io/host_random.h"
#include "models/io/in_parallel.h"
#include "models/io/tensors.h"
#include "models/methods/street_gaussians_renderer.h"
#include "models/render/undistort.h"
#include "models/splat/hidden_ground.h"
#include "models/splat/parameters.h"
#include "models/splat/sky_map.h"
#include "models/splat/sky_start.h"
#include "models/street/sky_region.h"
#include "models/street/street_sweeps.h"
#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/ops/cube_map.h"
#include "runtime/ops/ssim.h"

namespace cloam {
namespace {

constexpr float kFinalSky = 0.1f, kFinalCameras = 0.1f;  // on the rates
constexpr float kRoom = 0.1f;                            // metres around a box that an actor's gaussians may lie in
constexpr float kGone = -20;                             // logit of an opacity that growth removes
constexpr char kGroundMeans[] = "ground.means", kGroundColours[] = "ground.sh_first";
constexpr uint64_t kMirrors = 71;  // a stream of random numbers of its own

/// Before any is drawn: random Gaussians that are too many for the memory are told at once.
void require_room(const StreetStartOptions& start, size_t actors) {
  constexpr uint64_t kBytes = 3 * kGaussianBytes;  // with the parameters' moments
  const auto count = [](int wanted) { return static_cast<uint64_t>(wanted); };
  const uint64_t all = count(start.near) + count(start.far) + actors * count(start.fewest), budget = memory_budget();
  if (all * kBytes <= budget) return;
  throw Error(Fault::memory, text("initial.near, initial.far and, for each of ", actors, " actors, initial.fewest are ",
                                  all, " Gaussians, which need ", all * kBytes >> 20, " MiB of a budget of ",
                                  budget >> 20, " MiB\n  fix: fewer of them, or --max-memory if the machine has more"));
}

/// None in a checkpoint that was written before there was any.
Gaussians ground_in(const TensorMap& state) {
  const auto found = state.find(kGroundMeans);
  if (found == state.end()) return {};
  const std::vector<int64_t>& shape = found->second.shape;
  const std::vector<int64_t> wanted = {shape.empty() ? 0 : shape[0], 3};
  std::vector<float> means = values_from<float>(state, kGroundMeans, wanted);
  return flat_gaussians(std::move(means), values_from<float>(state, kGroundColours, wanted));
}

/// Directions [P,3] of a camera that moved, in the axes of where it was given.
Tensor directions_in(const ViewMove& move, const Tensor& directions) {
  Tensor out = directions;
  if (!move.lens.as_given()) out = directions_through(move.lens, out);
  if (move.turned_back) out = matmul(out, move.turned_back);
  return stop_gradient(out);
}

/// What a photo's pixels count for the sky's first colours, [H*W]: matter, too, little, so that something like the road
/// and the houses around is where no photo shows the sky; actors and what is masked not at all.
std::vector<float> sky_weights(const std::vector<uint8_t>& kinds, const FramePixels& photo) {
  std::vector<float> weights;
  weights.reserve(kinds.size());
  for (size_t i = 0; i < kinds.size(); ++i) {
    const bool counts = kinds[i] < kActorPixel && (photo.mask.empty() || photo.mask[i] > 0);
    weights.push_back(!counts ? 0 : kinds[i] == kSkyPixel ? 1 : kMaybeSky);
  }
  return weights;
}

}  // namespace

void StreetGaussians::configure(Config& c) {
  StreetGaussiansConfig& o = config_;
  c.bind("initial.lidar", o.start.lidar, "initial background Gaussians from LiDAR points", {0, 1 << 28});
  c.bind("initial.voxel", o.start.voxel, "metres: one LiDAR point of the background per voxel", kMetres);
  c.bind("initial.near", o.start.near, "random initial Gaussians above the horizon, as far as LiDAR sees",
         {0, 1 << 28});
  c.bind("initial.far", o.start.far, "random initial Gaussians above the horizon, beyond", {0, 1 << 28});
  c.bind("initial.actor", o.start.actor, "initial Gaussians of one actor from LiDAR points in its box", {0, 1 << 28});
  c.bind("initial.fewest", o.start.fewest, "with fewer LiDAR points, an actor starts with so many, random ones added",
         {1, 1 << 28});
  c.bind("initial.ground", o.start.ground,
         "lay Gaussians where actors hide the ground from all photos, behind all else and without training them");
  c.bind("near", o.near, "near plane, in metres");
  c.bind("sky.side", o.sky_side, "pixels per side of the sky's cube map", {1, 8192});
  c.bind("exposure", o.exposure, "learn a gain and an offset per camera and channel, with means 1 and 0");
  c.bind("actors.flip", o.flip, "how often a step sees an actor mirrored, left for right", {0, 1});
  c.bind("actors.waves", o.waves, "Fourier coefficients of an actor's base colour over time; 1: constant", {1, 64});
  c.bind("actors.max", o.actors_max, "largest number of Gaussians of all actors", {1, 1 << 28});
  bind_harmonics(c, o.harmonics);
  c.bind("weight.ssim", o.ssim, "weight of 1 - SSIM; the rest is the weight of L1", {0, 1});
  c.bind("weight.sky", o.sky,
         "weight of the sky loss: cross-entropy of opacity and where LiDAR says there is sky, and L1 of the sky's "
         "colours; 0 keeps their initial values");
  c.bind("weight.lidar", o.lidar, "weight of the LiDAR depth error, in metres");
  c.bind("weight.actors", o.actors,
         "weight of the actors' loss, once growth has ended: entropy of their opacity in boxes, none outside");
  c.bind("weight.outside", o.outside, "weight of the metres by which actors' Gaussians lie outside their boxes");
  c.bind("weight.hidden", o.hidden,
         "weight that pulls colours of actors' Gaussians to their actor's mean, so that what others hide keeps its "
         "colours");
  c.bind(
      "batch.depth_every", o.depth_every,
      "steps between those with the terms of depth and of actors' opacity and colours, with as many times the weight",
      kSteps);
  bind_rates(c, o.rates);
  c.bind("train.rate_sky", o.rate_sky, "learning rate of the sky; it falls to a tenth");
  c.bind("train.rate_exposure", o.rate_exposure, "learning rate of the exposures; it falls to a tenth");
  bind_boxes(c, o.boxes);
  bind_cameras(c, o.cameras);
  bind_growth(c, o.growth);
}

void StreetGaussians::build(const Scenes& scenes, uint64_t seed) {
  if (scenes.size() != 1) throw Error(Fault::usage, text("street-gaussians trains on one log, not ", scenes.size()));
  const Scene& scene = scenes.front();
  if (!scene.is_log) throw Error(Fault::data, "street-gaussians learns driving logs; for photos, use train splat");
  seed_ = seed;
  region_ = camera_region(scene);
  common_.up = scene.up;
  common_.metric = scene.metric;
  model_ = std::make_unique<StreetGaussiansModel>(config_, params_, scene);
  cameras_.build(config_.cameras, scene, params_, "", kPoseScaleOfLogs);
  background_growth_ = make_growth(config_.growth, region_);
  GrowthOptions of_actors = config_.growth;
  of_actors.max_count = config_.actors_max;
  actors_growth_ = make_growth(of_actors, {Eigen::Vector3d::Zero(), model_->actor_radius()});
  // What is there until load_data or a checkpoint.
  const Gaussians one = {{0, 0, 0}, {0, 0, 0}, {1, 0, 0, 0}, {0}, {0, 0, 0}, std::vector<float>(45)};
  model_->put({one, {}, {}});
  observed_.restart(count());
}

void StreetGaussians::load_data(std::vector<TrainingData> data) {
  const std::shared_ptr<const Scene> scene = data.front().scene.get();
  StreetSpace space(*scene, {});
  const LogSweeps sweeps = training_sweeps(data.front().scene, space, data.front().photos.store());
  const Pixels pixels = undistorted(data.front().photos.all());
  photos_ = std::make_unique<PhotoSource>(*scene, pixels);
  begin(*scene, sweeps, pixels);
  add_hints(*scene, space, sweeps, pixels);
  space.rest();
}

void StreetGaussians::begin(const Scene& scene, const LogSweeps& sweeps, const Pixels& pixels) {
  StreetStartOptions how = config_.start;
  how.seed = seed_;
  how.actors = config_.actors_max;
  require_room(how, scene.actors.size());
  StreetStart start = street_start(
      scene,
      [&](const auto& visit) {
        for (size_t i = 0; i < sweeps.size(); ++i) visit(sweeps.sweep(i), *sweeps.points(i));
      },
      how);
  std::vector<TimedPhoto> photos;
  for (const FramePixels& photo : pixels.frames) {
    const Frame& frame = scene.frames[photo.frame];
    photos.push_back({{photo, pixels.cameras[static_cast<size_t>(photo.camera)], frame.world_from_camera},
                      frame.timestamp.value_or(0)});
  }
  colour_street(photos, scene, start);
  model_->put(start);
  if (how.ground) model_->put_ground(hidden_ground(photos, scene, start));
  observed_.restart(count());
}

void StreetGaussians::add_hints(const Scene& scene, const StreetSpace& space, const LogSweeps& sweeps,
                                const Pixels& pixels) {
  std::vector<PixelDepths> depths(pixels.frames.size());
  in_parallel(depths.size(), [&](size_t i) {
    const FramePixels& photo = pixels.frames[i];
    const Frame& frame = scene.frames[photo.frame];
    for (size_t s = 0; s < sweeps.size(); ++s)
      if (sweeps.sweep(s).step == frame.step)
        depths[i] = pixel_depths(scene, frame, pixels.cameras[static_cast<size_t>(photo.camera)], sweeps.sweep(s),
                                 *sweeps.points(s));
  });
  SkyStart sky(config_.sky_side);
  std::vector<Tensor> directions;
  for (const Camera& camera : pixels.cameras) directions.push_back(directions_of(camera));
  for (size_t i = 0; i < depths.size(); ++i) {
    const FramePixels& photo = pixels.frames[i];
    const Frame& frame = scene.frames[photo.frame];
    const auto camera = static_cast<size_t>(photo.camera);
    PhotoHints hints;
    hints.time = frame.timestamp.value_or(0);
    hints.sensor = frame.sensor;
    std::vector<uint8_t> kinds = pixel_kinds(scene, frame, pixels.cameras[camera], space, depths[i]);
    follow_sky(kinds, photo);
    boxes_.emplace_back(pixels.cameras[camera], frame.world_from_camera, kinds);
    hints.kinds = from_host(kinds, {photo.height, photo.width});
    if (const auto found = static_cast<int64_t>(depths[i].pixels.size()); found > 0) {
      hints.pixels = from_host(depths[i].pixels, {found});
      hints.depths = from_host(depths[i].depths, {found});
    }
    hints.directions = directions[camera];
    sky.add(photo.rgba, sky_weights(kinds, photo),
            nearest_taps(sky_taps(hints.directions, frame.world_from_camera, config_.sky_side)));
    hints_.push_back(std::move(hints));
    loaded(i + 1, depths.size());
  }
  model_->put_sky(sky.faces(kFirstSky));
}

MemoryPlan StreetGaussians::memory(const PhotoSizes& photos) const {
  constexpr uint64_t kWaveBytes = 4 * 12;                       // of an actor's Gaussian, besides
  constexpr uint64_t kWork = 4 * 200 + 10 * 100, kPixel = 300;  // as splat, and the sky's
  const auto most = static_cast<uint64_t>(std::max<int64_t>(model_->count(kBackgroundPart), config_.growth.max_count)) +
                    static_cast<uint64_t>(config_.actors_max);
  MemoryPlan plan;
  plan.parameters = most * kGaussianBytes + static_cast<uint64_t>(config_.actors_max) * kWaveBytes +
                    4 * 18 * static_cast<uint64_t>(config_.sky_side) * static_cast<uint64_t>(config_.sky_side);
  plan.optimiser = 2 * plan.parameters;
  plan.images = photos.bytes + photos.bytes / 4;
  plan.work = most * kWork + photos.largest * kPixel;
  plan.smaller = "fewer Gaussians would fit: --set growth.max and actors.max";
  return plan;
}

ParameterGroups StreetGaussians::groups() const {
  ParameterGroups groups = gaussian_groups(config_.rates, kBackgroundPart, region_.radius);
  for (ParameterGroup& group : gaussian_groups(config_.rates, kActorsPart, model_->actor_radius()))
    groups.push_back(group);
  groups.push_back({kWavesName, config_.rates.first});
  groups.push_back({kSkyName, config_.rate_sky, {kFinalSky}});
  groups.push_back({kExposureName, config_.rate_exposure, {kFinalCameras}});
  for (ParameterGroup& group : groups) group.epsilon = 1e-15f;
  model_->boxes().add_groups(groups);
  cameras_.add_groups(groups);
  return groups;
}

/// Most actors are alike on both sides (NeuRAD, Tonderski et al. 2024, section 4.1): what a photo shows of one is held
/// to the other.
std::vector<bool> StreetGaussians::flips(const Progress& progress) const {
  std::vector<bool> mirrored;
  if (config_.flip <= 0) return mirrored;
  HostRandom random(mixed(progress.seed + kMirrors), static_cast<uint64_t>(progress.step));
  for (size_t a = 0; a < model_->actors().size(); ++a) mirrored.push_back(random.chance(double{config_.flip}));
  return mirrored;
}

Step StreetGaussians::step(const Progress& progress, const Tensors& wanted) {
  const size_t which = photos_->draw(progress.seed, progress.step, progress.share);
  const Photograph& photo = photos_->photographs()[which];
  const PhotoHints& hints = hints_[which];
  const bool compares_depth = progress.step % config_.depth_every == 0;
  DrawOptions how;
  how.depth = compares_depth;
  if (compares_depth) how.more = model_->of_actors();
  if (config_.growth.absolute)
    how.probe = parameter(std::vector<float>(static_cast<size_t>(2 * count())), {count(), 2});
  const View view{photo.camera, photo.world_from_camera, 0, hints.time};
  const ViewMove move = cameras_.move_of(which, photo.listed_camera);
  SeenStreet seen{
      hints,
      draw(model_->projection(view, move, degree_at(config_.harmonics, progress), flips(progress)), photo.camera, how),
      {},
      static_cast<float>(photo.camera.width) * static_cast<float>(photo.camera.height)};
  const Tensor taps = sky_taps(directions_in(move, hints.directions), photo.world_from_camera, config_.sky_side);
  const Shape planes = {3, photo.camera.height, photo.camera.width};
  const Tensor sky = reshape(cube_colours(stop_gradient(model_->sky_faces()), taps), planes);
  Tensor picture =
      model_->exposed(slice(seen.drawn.planes, 0, 0, 3) + unsqueeze(seen.drawn.transmittance, 0) * sky, hints.sensor);
  Tensor truth = slice(cast(photo.rgba, DType::f32) / 255.f, 0, 0, 3);
  if (photo.mask) {
    seen.used = cast(photo.mask, DType::f32) / 255.f;
    picture = picture * unsqueeze(seen.used, 0);
    truth = truth * unsqueeze(seen.used, 0);
  }
  const Likeness alike = likeness(picture, truth);
  Tensor loss = (1.f - config_.ssim) * alike.l1 + config_.ssim * (1.f - alike.ssim);
  const Tensor nearest_sky = reshape(cube_colours(model_->sky_faces(), nearest_taps(taps)), planes);
  loss =
      loss + config_.sky * (sky_term(seen) + sky_colour_term(seen, model_->exposed(nearest_sky, hints.sensor), truth));
  if (model_->has_actors()) loss = loss + config_.outside * outside_term(*model_);
  loss = model_->boxes().with_smoothness(loss);
  const auto every = static_cast<float>(config_.depth_every);
  if (compares_depth && hints.pixels) loss = loss + every * config_.lidar * lidar_term(seen);
  if (compares_depth && model_->has_actors()) loss = loss + every * config_.hidden * hidden_term(seen, *model_);
  if (compares_depth && model_->has_actors() && progress.step > background_growth_->until(progress))
    loss = loss + every * config_.actors * actors_term(seen);
  for (const char* part : {kBackgroundPart, kActorsPart})
    if (model_->count(part) > 0)
      if (const Tensor penalty = background_growth_->penalty(splat_model(params_, 0, part).cloud))
        loss = loss + penalty;
  Tensors all = wanted;
  all.push_back(how.probe ? how.probe : seen.drawn.seen);
  Step step = step_of(loss, all);
  observed_.add(seen.drawn, step.gradients.back());
  step.gradients.pop_back();
  step.figures = {psnr_figure(mean(square(picture - truth))), {"gaussians", static_cast<double>(count())}};
  for (const Figure& figure : model_->boxes().figures()) step.figures.push_back(figure);
  for (const Figure& figure : cameras_.figures()) step.figures.push_back(figure);
  step.more = observed_.pending();
  step.sums = observed_.of_view();
  return step;
}

void StreetGaussians::shift(Growth& growth, const char* part, const Progress& progress) {
  if (model_->count(part) == 0) return;
  const std::string means = std::string(part) + "means";
  const float rate = group_of(means, groups()).rate_at(progress);
  if (const Tensor by = growth.shift(splat_model(params_, 0, part).cloud, progress, rate))
    assign({{params_.at(means), params_.at(means) + by}});
}

RowMoves StreetGaussians::grow(const Progress& progress) {
  shift(*background_growth_, kBackgroundPart, progress);
  shift(*actors_growth_, kActorsPart, progress);
  if (!background_growth_->due(progress)) return {};
  const GrowthStatistics all = observed_.statistics();
  const auto middle = all.gradients.begin() + model_->count(kBackgroundPart);
  RowMoves moves = grow_background({{all.gradients.begin(), middle}}, progress);
  for (RowMove& move : grow_actors({{middle, all.gradients.end()}}, progress)) moves.push_back(std::move(move));
  if (!moves.empty()) observed_.restart(count());
  return moves;
}

/// Those that photos show only where boxes are go with those that are faint: nothing shows that they are there, and
/// they would stand in for an actor who stays in one place of the picture.
RowMoves StreetGaussians::grow_background(const GrowthStatistics& statistics, const Progress& progress) {
  Gaussians all = gaussians_in(params_, common_, kBackgroundPart);
  const std::vector<bool> hidden = only_in_boxes(all.means, boxes_);
  for (size_t i = 0; i < all.count(); ++i)
    if (hidden[i]) all.opacities[i] = kGone;
  const GrowthMoves moves = background_growth_->grow(all, statistics, progress);
  if (all.count() == 0)
    throw Error(Fault::diverged,
                text("no Gaussian of the background is left after step ", progress.step,
                     "\n  fix: --set growth.prune_opacity=0.001, or lower rates; are the poses right?"));
  if (!moves.any()) return {};
  put_gaussians(params_, all, kBackgroundPart);
  return row_moves(moves, kBackgroundPart);
}

/// Those that left their boxes go with those that are faint.
RowMoves StreetGaussians::grow_actors(const GrowthStatistics& statistics, const Progress& progress) {
  if (!model_->has_actors()) return {};
  Gaussians all = gaussians_in(params_, common_, kActorsPart);
  const std::vector<int32_t> owners = model_->owners();
  for (size_t i = 0; i < all.count(); ++i) {
    const Eigen::Vector3d half = model_->actors()[static_cast<size_t>(owners[i])].size / 2;
    for (size_t k = 0; k < 3; ++k)
      if (std::abs(all.means[3 * i + k]) > static_cast<float>(half[static_cast<Eigen::Index>(k)]) + kRoom)
        all.opacities[i] = kGone;
  }
  const GrowthMoves moves = actors_growth_->grow(all, statistics, progress);
  if (!moves.any() || all.count() == 0) return {};
  put_gaussians(params_, all, kActorsPart);
  RowMoves out = row_moves(moves, kActorsPart);
  std::vector<int32_t> new_owners;
  for (const int32_t row : moves.parent) new_owners.push_back(owners[static_cast<size_t>(row)]);
  if (config_.waves > 1) {
    const auto rows = static_cast<int64_t>(moves.parent.size());
    const Tensor waves = gather_rows(params_.at(kWavesName), from_host(moves.parent, {rows}));
    params_[kWavesName] = parameter(waves.to_host(), waves.shape());
    out.push_back({kWavesName, moves.source});
  }
  model_->set_owners(std::move(new_owners));
  return out;
}

void StreetGaussians::fit_to(const TensorMap& parameters) {
  model_->fit_to(parameters);
  observed_.restart(count());
}

TensorMap StreetGaussians::state() const {
  TensorMap out = observed_.state();
  out["owners"] = named_integers({model_->owners().begin(), model_->owners().end()});
  model_->boxes().add_state(out);
  if (model_->ground().empty()) return out;
  out[kGroundMeans] = named(model_->ground().at("means"));
  out[kGroundColours] = named(model_->ground().at("sh_first"));
  return out;
}

void StreetGaussians::restore(const TensorMap& state) {
  observed_.restore(state);
  const std::vector<int64_t> owners = integers_from(state, "owners", model_->owners().size());
  const auto actors = static_cast<int64_t>(model_->actors().size());
  if (std::any_of(owners.begin(), owners.end(), [&](int64_t owner) { return owner < 0 || owner >= actors; }))
    throw Error(Fault::data, text("the checkpoint has Gaussians of actors that the run's log has not (it has ", actors,
                                  " actors)\n  fix: put the run's own scene.json back, or train anew"));
  model_->set_owners({owners.begin(), owners.end()});
  model_->boxes().restore(state);
  model_->put_ground(ground_in(state));
}

Gaussians StreetGaussians::actor_gaussians(const AssetName& asset) const {
  Gaussians like = common_;
  like.up = Eigen::Vector3d::UnitZ();
  return model_->gaussians_of(model_->place_of(asset), like);
}

void StreetGaussians::adopt(std::size_t place, const Gaussians& looks) {
  model_->adopt(place, looks);
  observed_.restart(count());
}

Picture StreetGaussians::render(const View& view) { return picture_of(*model_, view); }

LidarReturns StreetGaussians::measure(const WorldRays& rays) { return returns_of(*model_, rays); }

Picture StreetGaussians::render_asset(const AssetName& asset, const Camera& camera,
                                      const Eigen::Matrix4d& box_from_camera) {
  return asset_picture(*model_, model_->place_of(asset), camera, box_from_camera);
}

}  // namespace cloam
