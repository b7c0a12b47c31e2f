// See genassets_training.h.
#include "models/methods/genassets_training.h"

#include <cmath>

#include "models/io/host_random.h"
#include "models/street/least_errors.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr int kStreetWarmUp = 30;  // steps
constexpr int kCodesFirst = 200;   // steps in which one image teaches no background behind actors
constexpr float kDetail = 0.2f;    // of the background planes' rate, for texels beside codes
constexpr float kRefining = 0.1f;  // of the codes' rate, once they have been denoised (SSDNeRF: 5e-3)
constexpr double kWorst = 0.05;    // share of LiDAR rays that are left out
constexpr int64_t kAhead = 8;      // steps whose images are decoded ahead
constexpr size_t kShownLogs = 4;   // whose voxels stay on the device

void hold(PatchDiscriminator::Block& block) {
  block.weight = stop_gradient(block.weight);
  if (block.bias) block.bias = stop_gradient(block.bias);
}

/// Mean squared error without the worst rays (UniSim), but linear beyond a metre (Huber): in the first steps rays are
/// tens of metres wrong, and Adam's second moments of planes and networks would long be too large for colours to count.
Tensor lidar_loss(const Tensor& depth, const Tensor& ranges, bool linear) {
  const Tensor metres = abs(depth - ranges),
               error = linear ? where(metres < 1.f, square(metres), 2.f * metres - 1.f) : square(metres);
  const int64_t count = error.dim(0),
                kept = std::max<int64_t>(1, static_cast<int64_t>((1 - kWorst) * static_cast<double>(count)));
  return mean_of_least(error, kept);
}

/// For the progress line: metres, of which more than one counts as one.
Tensor lidar_error(const Tensor& depth, const Tensor& ranges) {
  return mean(minimum(abs(stop_gradient(depth) - ranges), 1.f));
}

Figure count(const char* name, int64_t number) { return {name, static_cast<double>(number)}; }

}  // namespace

GenAssetsTraining::GenAssetsTraining(const GenAssetsConfig& config, StreetModel& model, const Scope& networks,
                                     uint64_t seed)
    : config_(config), model_(model), seed_(seed) {
  if (config.weight_perceptual > 0) perceptual_ = feature_network(config.perceptual_weights);
  if (config.weight_adversarial > 0)
    discriminator_.emplace(networks / "discriminator",
                           whole_numbers("adversarial.widths", config.discriminator_widths));
}

ParameterGroups GenAssetsTraining::groups(bool denoised) const {
  const GenAssetsConfig& c = config_;
  const LearningRateSchedule schedule = {c.final_rate, c.decay_start, 0, kStreetWarmUp};
  ParameterGroups groups;
  const auto add = [&](const std::string& prefix, float rate) -> ParameterGroup& {
    return groups.emplace_back(ParameterGroup{prefix, rate, schedule});
  };
  for (const auto& [name, rate] : {std::pair("decoder", c.rate_decoder),
                                   {"field", c.rate_field},
                                   {"image", c.rate_image},
                                   {"shadow", c.rate_field},
                                   {"discriminator", c.rate_discriminator}})
    add(std::string("networks.") + name, rate).frozen = c.street.frozen;
  for (size_t i = 0; i < model_.logs().size(); ++i) {
    const std::string log = "log" + std::to_string(i);
    // Rows of a log stand still in steps that see other logs (sparse): Adam's momentum would move them on.
    add(log + ".background", c.rate_background).sparse = true;
    add(log + ".common.background", c.rate_background).sparse = true;
    add(log + ".codes", c.rate_codes * (denoised ? kRefining : 1.f)).sparse = true;
    add(log + ".planes", c.rate_background).sparse = true;
    ParameterGroup& detail = add(log + ".detail", c.rate_background * kDetail);
    detail.sparse = true;
    // One image says nothing of other sides: there codes must explain all that they can.
    const LogSource* data = model_.logs()[i].data.get();
    detail.frozen = data && data->images() == 1;
    model_.logs()[i].boxes.add_groups(groups, true);
    model_.logs()[i].cameras.learned().add_groups(groups);
  }
  return groups;
}

/// The decoder's term, through a discriminator that holds still, and the discriminator's own, which reaches it alone;
/// photographs are real, renders are not.
Tensor GenAssetsTraining::adversarial_loss(const Tensor& image, const Tensor& truth) const {
  PatchDiscriminator still = *discriminator_;
  for (PatchDiscriminator::Block& block : still.blocks) hold(block);
  hold(still.last);
  const Tensor fooled = bce_with_logits(still(image), 1.f);
  const Tensor told =
      bce_with_logits((*discriminator_)(truth), 1.f) + bce_with_logits((*discriminator_)(stop_gradient(image)), 0.f);
  return fooled * config_.weight_adversarial + told;
}

Tensor GenAssetsTraining::image_loss(const Compared& of) const {
  const int64_t height = of.image.dim(2), width = of.image.dim(3), least = std::min(height, width);
  const int64_t multiple = int64_t{1} << (discriminator_ ? discriminator_->blocks.size() : 0);
  const bool halves = height % multiple == 0 && width % multiple == 0 && least >= 2 * multiple;
  Tensor total = of.squared * (config_.weight_rgb * of.share);
  if (perceptual_ && (!of.window || least >= perceptual_->smallest))
    total = total + perceptual_loss(*perceptual_, of.image, of.truth) * (config_.weight_perceptual * of.share);
  if (discriminator_ && (!of.window || halves)) total = total + adversarial_loss(of.image, of.truth) * of.share;
  return total;
}

Tensor GenAssetsTraining::object_loss(const Tensor& image, const Tensor& truth) const {
  const int64_t side = config_.object_side;
  return perceptual_loss(*perceptual_, resize_bilinear(image, side, side), resize_bilinear(truth, side, side)) *
         config_.weight_perceptual;
}

Tensor GenAssetsTraining::with_silhouette(const Tensor& total, const Tensor& opacity, const Tensor& wanted) const {
  if (!wanted) return total;
  const Tensor error = where(wanted < 0.f, 0.f, square(opacity - wanted));
  return total + mean(error) * config_.weight_silhouette;
}

Tensor GenAssetsTraining::lidar_terms(const Tensor& depth, const Tensor& ranges, const Tensor& line_of_sight) const {
  return lidar_loss(depth, ranges, config_.linear_lidar) * config_.weight_lidar +
         mean(line_of_sight) * config_.weight_line_of_sight;
}

Sampling GenAssetsTraining::sampling(const StreetLog& log, const Progress& progress, bool skip_hidden) const {
  // Of one image the background could learn the actors' picture where it lies behind them: no other image says that it
  // is wrong, and codes, which begin slowly, would have nothing left to explain.
  const bool detach = config_.street.frozen && log.data->images() == 1 && progress.step <= kCodesFirst;
  const auto share = static_cast<uint32_t>(progress.share.rank);
  return {{seed_, static_cast<uint32_t>(progress.step), 0}, true, skip_hidden, share, detach, log.boxes.on()};
}

void GenAssetsTraining::look_ahead(const Progress& progress) {
  const int64_t now = progress.step;
  const std::vector<StreetLog>& logs = model_.logs();
  logs.front().data->photos().begin(now);
  if (announced_ < now || announced_ > now + kAhead) announced_ = now;  // the first, or it went back
  while (announced_ < now + kAhead) {
    const int64_t step = ++announced_;
    // What that step will see is told by its log's boxes: they are unpacked earlier still.
    logs[HostRandom(seed_, static_cast<uint64_t>(step + kAhead)).below(logs.size())].scene.want(step + kAhead);
    StepAhead ahead{{seed_, static_cast<uint64_t>(step)}, step, progress.share};
    const size_t log = ahead.random.below(logs.size());
    const LogSource& data = *logs[log].data;
    if (cells_) cells_->want(log, step);
    if (config_.whole_images) {
      data.expect_image(ahead);
    } else {
      const int64_t side = data.patch_side(config_.patch_side);
      data.expect_patches(ahead, config_.patches, side);
      if (sees_objects()) data.expect_object(ahead, {1, 2 * side});
    }
    data.expect_returns(ahead, config_.lidar_rays);
  }
}

void GenAssetsTraining::unpack_ahead() {
  const std::vector<StreetLog>& logs = model_.logs();
  const auto& store = logs.front().data->photos().store();
  if (!store) return;
  cells_.emplace(
      store, logs.size(), [&logs](size_t log) { return logs[log].space->unpacked(); },
      [&logs](size_t log) { return logs[log].space->unpacked_bytes(); });
}

const StreetLog& GenAssetsTraining::met(size_t log) {
  const StreetLog& now = model_.logs()[log];
  if (!cells_) return now;
  std::erase(shown_, log);
  shown_.push_back(log);
  for (; shown_.size() > kShownLogs; shown_.pop_front()) model_.logs()[shown_.front()].space->rest();
  if (!now.space->is_shown()) now.space->show(*(*cells_)[log]);
  return now;
}

StreetStep GenAssetsTraining::step(const Progress& progress, const Tensors& wanted) {
  look_ahead(progress);
  HostRandom random(seed_, static_cast<uint64_t>(progress.step));
  const StreetLog& log = met(random.below(model_.logs().size()));
  return config_.whole_images ? in_tiles(log, random, progress, wanted) : on_patches(log, random, progress, wanted);
}

StreetStep GenAssetsTraining::on_patches(const StreetLog& log, HostRandom& random, const Progress& progress,
                                         const Tensors& wanted) {
  const int64_t side = log.data->patch_side(config_.patch_side);
  RayList rays;
  const Photographed photos = log.data->add_patches(rays, random, config_.patches, side, progress.share);
  const Tensor& truth = photos.truth;
  const int64_t patch_rays = rays.count();
  const Photographed object =
      sees_objects() ? log.data->add_object(rays, random, {1, 2 * side}, progress.share) : Photographed();
  const int64_t camera_rays = rays.count();
  log.data->add_returns(rays, random, config_.lidar_rays, progress.share);
  const int64_t all = rays.count();
  // A pass through the distance alone finds what lies behind surfaces; it pays once a quarter of the samples are dark.
  skipped_ = progress.step <= 3 || lit_permille < 750 || progress.step % 16 == 0;
  Sampling how = sampling(log, progress, skipped_);
  std::vector<RaysOfPhoto> parts;
  for (const PhotoOf& of : photos.of) parts.push_back({of.frame, patch_rays / static_cast<int64_t>(photos.of.size())});
  if (object.truth) parts.push_back({object.of.front().frame, camera_rays - patch_rays});
  if (log.cameras.learned().on()) how.rays = log.cameras.moved(rays, parts);
  const RenderedRays seen = model_.render(model_.street(log, rays), rays, how, true);
  const auto image_of = [&](int64_t begin, int64_t end, const Photographed& photo) {
    const int64_t rows = photo.truth.dim(2) / model_.scale(), columns = photo.truth.dim(3) / model_.scale();
    const auto map = [&](const Tensor& x) {
      return permute(reshape(slice(x, 0, begin, end), {photo.truth.dim(0), rows, columns, x.dim(1)}), {0, 3, 1, 2});
    };
    return photo.kept(model_.image_of(map(seen.features), seen.shadow ? map(seen.shadow) : Tensor()));
  };
  const Tensor image = image_of(0, patch_rays, photos);
  const Tensor squared = mean(square(image - truth));
  Tensor total = image_loss({image, truth, squared});
  if (object.truth) total = total + object_loss(image_of(patch_rays, camera_rays, object), object.truth);
  total = with_silhouette(total, slice(seen.actor_opacity, 0, 0, patch_rays), photos.silhouette);
  if (object.truth)
    total = with_silhouette(total, slice(seen.actor_opacity, 0, patch_rays, camera_rays), object.silhouette);
  std::vector<Figure> figures = {
      psnr_figure(photos.share < 1 ? squared * (1 / std::max(photos.share, 1e-6f)) : squared)};
  if (all > camera_rays) {
    const Tensor depth = slice(seen.depth, 0, camera_rays, all);
    const Tensor ranges =
        from_host(std::vector<float>(rays.ranges.begin() + camera_rays, rays.ranges.end()), {all - camera_rays});
    total = total + lidar_terms(depth, ranges, slice(seen.line_of_sight, 0, camera_rays, all));
    figures.push_back({"lidar_m", 0, lidar_error(depth, ranges)});
  }
  if (seen.assets.kl) total = total + seen.assets.kl * config_.weight_kl;
  const int64_t samples = seen.samples.t.dim(0);
  samples_ = static_cast<double>(samples);
  marched_ = static_cast<double>(seen.marched);
  Step step = step_of(log.boxes.with_smoothness(total), wanted);
  step.figures = std::move(figures);
  step.weight = static_cast<double>(progress.share.size(config_.patches)) / config_.patches;
  step.counts = {&samples_, &marched_};
  step.figures.push_back(count("samples", samples * progress.share.ranks));
  step.figures.push_back(count("actors", seen.assets.planes ? seen.assets.planes.dim(1) : 0));
  for (const Figure& figure : log.boxes.figures()) step.figures.push_back(figure);
  for (const Figure& figure : log.cameras.learned().figures()) step.figures.push_back(figure);
  step.figures.push_back(
      {"lit", skipped_ ? (samples_ + 1) / (marched_ + 1) : static_cast<double>(lit_permille) / 1000});
  return {std::move(step), seen.assets.codes};
}

void GenAssetsTraining::after_step() {
  if (skipped_) lit_permille = 1000 * (std::llround(samples_) + 1) / (std::llround(marched_) + 1);
}

// ---- Whole images: a graph of all their rays and pixels would not fit in memory, so a step goes through them in
// tiles. Features first, without gradients; then pixels window by window, which gives the gradients by features; then
// the rays again, tile by tile, with gradients; last the asset decoder, once.

/// What the passes over one image share.
struct GenAssetsTraining::WholeImage {
  const GenAssetsTraining& training;
  const StreetLog& log;
  Sampling how;
  RayList rays, returns;
  Photographed photo;
  DecodedAssets decoded, given;       // of all actors that may be seen; given: with the planes as a leaf
  HostMap features = {}, slope = {};  // slope: the gradient by features
  int64_t samples = 0;
  double squared = 0;  // mean over the image

  int64_t channels() const { return training.model_.options().field.features; }
  int64_t end_of(int64_t begin) const { return std::min(rays.count(), begin + training.config_.tile_rays); }
  RenderedRays render(int64_t begin) const {
    const StreetModel& model = training.model_;
    const RayList part = part_of(rays, begin, end_of(begin));
    Sampling as = how;
    if (log.cameras.learned().on()) as.rays = log.cameras.moved(part, {{photo.of.front().frame, part.count()}});
    return model.render(model.street(log, rays), part, as, true, &given);
  }
  void look();
  /// A part of the image, made of the cells around it.
  struct Window {
    Tile outer = {};
    Tensor cells, image, truth;
  };
  Window decode(const Tile& inner) const;
  void decode_pixels(GradientSums& sums);
  void decode_objects(GradientSums& sums);
  void render_again(GradientSums& sums);
};

/// Features of all rays, and how much light is left there.
void GenAssetsTraining::WholeImage::look() {
  const int scale = training.model_.scale();
  features = {photo.truth.dim(2) / scale, photo.truth.dim(3) / scale, channels() + 3};
  for (int64_t begin = 0; begin < rays.count(); begin = end_of(begin)) {
    const RenderedRays seen = render(begin);
    const Tensor light = seen.shadow ? seen.shadow : ones({end_of(begin) - begin, 3});
    const std::vector<float> values = stop_gradient(concat({seen.features, light}, 1)).to_host();
    features.values.insert(features.values.end(), values.begin(), values.end());
    samples += seen.samples.t.dim(0);
  }
  slope = {features.rows, features.columns, features.channels, std::vector<float>(features.values.size(), 0.f)};
}

GenAssetsTraining::WholeImage::Window GenAssetsTraining::WholeImage::decode(const Tile& inner) const {
  const int64_t wide = channels(), scale = training.model_.scale();
  Window window;
  window.outer = widened(inner, kHalo, features);
  window.cells = cut(features, window.outer);
  const Tensor map = permute(window.cells, {0, 3, 1, 2});
  const Tensor whole = training.model_.image_of(slice(map, 1, 0, wide), slice(map, 1, wide, wide + 3));
  const auto part = [&](const Tensor& x) { return x ? cropped(x, inner, scale) : x; };
  window.truth = part(photo.truth);
  window.image = Photographed{window.truth, part(photo.used)}.kept(
      cropped(whole, {inner.x - window.outer.x, inner.y - window.outer.y, inner.columns, inner.rows}, scale));
  return window;
}

/// Their perceptual loss, as a mean over them.
void GenAssetsTraining::WholeImage::decode_objects(GradientSums& sums) {
  for (const Region& object : photo.objects) {
    const Window window = decode({object.x, object.y, object.columns, object.rows});
    const Tensor loss =
        training.object_loss(window.image, window.truth) * (1.f / static_cast<float>(photo.objects.size()));
    add_to(slope, window.outer, sums.add(loss, {window.cells})[0].to_host());
  }
}

void GenAssetsTraining::WholeImage::decode_pixels(GradientSums& sums) {
  constexpr int64_t kMultiple = 4;  // of cells a window: the discriminator halves pixels four times
  const int64_t side = std::max(kMultiple, int64_t{training.config_.tile_side} / kMultiple * kMultiple);
  for (const Tile& inner : tiles_of(features, side)) {
    const Window window = decode(inner);
    const double share =
        static_cast<double>(inner.columns * inner.rows) / static_cast<double>(features.rows * features.columns);
    const Tensor error = mean(square(window.image - window.truth));
    const Tensors found =
        sums.add(training.image_loss({window.image, window.truth, error, static_cast<float>(share), true}),
                 {window.cells}, {stop_gradient(error)});
    add_to(slope, window.outer, found[0].to_host());
    squared += share * static_cast<double>(found[1].item());
  }
}

void GenAssetsTraining::WholeImage::render_again(GradientSums& sums) {
  const int64_t wide = channels();
  for (int64_t begin = 0; begin < rays.count(); begin = end_of(begin)) {
    const int64_t end = end_of(begin);
    const std::vector<float> part(slope.values.begin() + begin * slope.channels,
                                  slope.values.begin() + end * slope.channels);
    const Tensor by = from_host(part, {end - begin, slope.channels});
    const RenderedRays seen = render(begin);
    Tensor along = sum(seen.features * slice(by, 1, 0, wide));
    if (seen.shadow) along = along + sum(seen.shadow * slice(by, 1, wide, wide + 3));
    const Tensor wanted = photo.silhouette ? slice(photo.silhouette, 0, begin, end) : Tensor();
    const float share = static_cast<float>(end - begin) / static_cast<float>(rays.count());
    along = training.with_silhouette(along * (1 / share), seen.actor_opacity, wanted) * share;
    sums.add(along);
  }
}

StreetStep GenAssetsTraining::in_tiles(const StreetLog& log, HostRandom& random, const Progress& progress,
                                       const Tensors& wanted) {
  WholeImage image{*this, log, sampling(log, progress, true), {}, {}, {}, {}, {}};
  const ObjectPatches objects = {sees_objects() ? config_.objects : 0, config_.tile_side};
  image.photo = log.data->add_image(image.rays, random, objects, progress.share);
  image.returns.actors = image.rays.actors;
  log.data->add_returns(image.returns, random, config_.lidar_rays, progress.share);
  image.decoded = image.given = model_.assets().decode(hit_assets(log.appearance, image.rays.actors), image.how);
  Tensor& planes = image.given.planes;
  if (planes) planes = parameter(planes.to_host(), planes.shape());
  Tensors reached = wanted;
  if (planes) reached.push_back(planes);
  GradientSums sums(reached);
  image.look();
  image.decode_pixels(sums);
  image.decode_objects(sums);
  image.render_again(sums);
  if (const Tensor jerky = log.boxes.smoothness()) sums.add(jerky);
  Step step{full({}, config_.weight_rgb * static_cast<float>(image.squared)), {}};
  step.figures = {psnr_figure(full({}, static_cast<float>(image.squared))),
                  count("samples", image.samples * progress.share.ranks),
                  count("actors", planes ? planes.dim(1) : 0),
                  {"lit", static_cast<double>(lit_permille) / 1000}};
  if (image.returns.count() > 0) {
    const RenderedRays seen =
        model_.render(model_.street(log, image.returns), image.returns, image.how, false, &image.given);
    const Tensor ranges = from_host(image.returns.ranges, {image.returns.count()});
    const Tensor of_lidar = lidar_terms(seen.depth, ranges, seen.line_of_sight);
    const Tensors found = sums.add(of_lidar, {}, {stop_gradient(of_lidar), lidar_error(seen.depth, ranges)});
    step.loss = step.loss + found[0];
    step.figures.push_back({"lidar_m", 0, found[1]});
  }
  for (const Figure& figure : log.boxes.figures()) step.figures.push_back(figure);
  for (const Figure& figure : log.cameras.learned().figures()) step.figures.push_back(figure);
  step.gradients = sums.sums();
  if (!planes) return {std::move(step), {}};
  const Tensor by_planes = step.gradients.back();
  step.gradients.pop_back();
  Tensor along = by_planes ? sum(image.decoded.planes * by_planes) : Tensor(0.f);
  if (image.decoded.kl) along = along + image.decoded.kl * config_.weight_kl;
  GradientSums of_decoder(wanted);
  of_decoder.add(along);
  for (size_t i = 0; i < wanted.size(); ++i)
    if (const Tensor& more = of_decoder.sums()[i])
      step.gradients[i] = step.gradients[i] ? step.gradients[i] + more : more;
  return {std::move(step), image.decoded.codes};
}

}  // namespace cloam
