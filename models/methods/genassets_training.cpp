// GenAssets learning: its losses, learning rates and steps of training.
#include <algorithm>
#include <cmath>

#include "models/methods/genassets.h"

namespace cloam {
namespace {

constexpr int64_t kSamples = 40;     // of a street's ray, as a rule
constexpr float kCommonSteps = 100;  // before codes of their own come up, if the networks are another run's
constexpr float kRefining = 0.1f;    // of the codes' rate, once they have been denoised (SSDNeRF: 5e-3)
constexpr float kTexels = 0.4f;      // of the texels' rate, if the networks are another run's
constexpr float kKeeping = 0.25f;    // of their decay, then
constexpr double kWorst = 0.05;      // share of LiDAR rays that are left out

void hold(PatchDiscriminator::Block& block) {
  block.weight = stop_gradient(block.weight);
  if (block.bias) block.bias = stop_gradient(block.bias);
}

}  // namespace

MemoryPlan GenAssets::memory(const PhotoSizes& photos) const {
  MemoryPlan plan;
  for (const auto& [name, p] : params_) plan.parameters += static_cast<uint64_t>(p.numel()) * 4;
  plan.optimiser = 2 * plan.parameters;
  plan.images = photos.bytes;
  const int64_t window = int64_t{config_.tile_side} + 2 * kHalo, patch = config_.patch_side;
  const int64_t cells = config_.whole_images ? window * window : config_.patches * patch * patch,
                rays =
                    config_.whole_images ? std::max(config_.tile_rays, config_.lidar_rays) : cells + config_.lidar_rays;
  const int64_t texels = 3 * int64_t{config_.field.plane_channels};
  const int64_t a_sample = 4 * (7 * texels + 18 * int64_t{config_.field.width} + config_.field.features);
  const int64_t a_pixel = 4 * config_.image.width * (6 + 4 * int64_t{config_.image.blocks});
  plan.work = plan.parameters +
              static_cast<uint64_t>(rays * kSamples * a_sample + cells * image_->scale() * image_->scale() * a_pixel);
  return plan;
}

std::vector<LearningRate> GenAssets::learning_rates(const Progress& progress) const {
  const float along = std::clamp((progress.fraction() - config_.decay_start) / (1.f - config_.decay_start), 0.f, 1.f);
  const float now = std::pow(config_.final_rate, along) * std::min(1.f, static_cast<float>(progress.step) / 30.f);
  std::vector<LearningRate> rates = {{"networks.decoder", config_.rate_decoder * now},
                                     {"networks.field", config_.rate_field * now},
                                     {"networks.image", config_.rate_image * now},
                                     {"networks.shadow", config_.rate_field * now},
                                     {"networks.discriminator", config_.rate_discriminator * now}};
  for (LearningRate& rate : rates) rate.frozen = frozen_;
  // With networks that know actors already: first what all actors of the log share, then each its own. Denoised codes
  // fit already, and what they share would move all by what the largest wants.
  const float alone = static_cast<float>(progress.step) / kCommonSteps - 1;
  const bool denoised = prior_ && prior_->denoises();
  const float own = denoised ? kRefining : frozen_ ? std::clamp(alone, 0.01f, 1.f) : 1.f;
  for (size_t i = 0; i < logs_.size(); ++i) {
    const std::string log = "log" + std::to_string(i);
    // A log alone is seen by few cameras: what its texels leave to what they have in common holds where none looked.
    const float texels = config_.rate_background * now * (frozen_ ? kTexels : 1.f);
    const float decay = config_.decay_background * (frozen_ ? kKeeping : 1.f);
    rates.push_back({log + ".background", texels, true, false, decay});
    rates.push_back({log + ".common.background", config_.rate_background * now});
    rates.push_back({log + ".common.code", config_.rate_codes * now});
    rates.back().frozen = denoised;
    rates.push_back({log + ".codes", config_.rate_codes * now * own, true});
    rates.push_back({log + ".planes", config_.rate_background * now, true});
  }
  return rates;
}

/// Mean squared error without the worst rays (UniSim), but linear beyond a metre (Huber): in the first steps rays are
/// tens of metres wrong, and Adam's second moments of planes and networks would long be too large for colours to count.
Tensor GenAssets::lidar_loss(const Tensor& depth, const Tensor& ranges) const {
  const Tensor metres = abs(depth - ranges), error = where(metres < 1.f, square(metres), 2.f * metres - 1.f);
  const int64_t count = error.dim(0),
                kept = std::max<int64_t>(1, static_cast<int64_t>((1 - kWorst) * static_cast<double>(count)));
  const Tensor limit = slice(sort(stop_gradient(error)).keys, 0, kept - 1, kept);
  return sum(where(error <= limit, error, 0.f)) * (1.f / static_cast<float>(kept));
}

/// The decoder's term, through a discriminator that holds still, and the discriminator's own, which reaches it alone;
/// photographs are real, renders are not.
Tensor GenAssets::adversarial_loss(const Tensor& image, const Tensor& truth) const {
  PatchDiscriminator still = *discriminator_;
  for (PatchDiscriminator::Block& block : still.blocks) hold(block);
  hold(still.last);
  const Tensor fooled = bce_with_logits(still(image), 1.f);
  const Tensor told =
      bce_with_logits((*discriminator_)(truth), 1.f) + bce_with_logits((*discriminator_)(stop_gradient(image)), 0.f);
  return fooled * config_.weight_adversarial + told;
}

/// Whether the step sees actors without a view direction: else colours would follow directions that one actor alone
/// was seen from, and change when it turns.
bool GenAssets::blind(const Progress& progress) const {
  return HostRandom(~seed_, static_cast<uint64_t>(progress.step)).uniform() < config_.view_drop;
}

/// How a training step draws this log.
GenAssets::Drawing GenAssets::drawing(const Log& log, const Progress& progress, bool skim) const {
  // Of one image the background could learn the actors' picture where it lies behind them: no other image says that it
  // is wrong, and codes, which begin slowly, would have nothing left to explain.
  const bool apart = frozen_ && log.data->images() == 1 && static_cast<float>(progress.step) <= 2 * kCommonSteps;
  return {{seed_, static_cast<uint32_t>(progress.step), 0}, true, skim, blind(progress), apart};
}

Tensor GenAssets::loss(const Progress& progress) {
  HostRandom random(seed_, static_cast<uint64_t>(progress.step));
  const Log& log = logs_[random.below(logs_.size())];
  const int64_t patches = config_.patches, side = log.data->patch_side(config_.patch_side);
  RayList rays;
  const Tensor truth = log.data->add_patches(rays, *log.space, random, patches, side);
  const int64_t camera_rays = rays.count();
  if (log.data->has_lidar()) log.data->add_returns(rays, *log.space, random, config_.lidar_rays);
  const int64_t all = rays.count();
  // A pass through the distance alone finds what lies behind surfaces; it pays once a quarter of the samples are dark.
  const bool skim = progress.step <= 3 || lit_permille_ < 750 || progress.step % 16 == 0;
  const Shaded seen = shade(street(log, rays), rays, drawing(log, progress, skim), true);
  const auto map = [&](const Tensor& x) {
    return permute(reshape(slice(x, 0, 0, camera_rays), {patches, side, side, x.dim(1)}), {0, 3, 1, 2});
  };
  const Tensor image = image_of(map(seen.features), seen.shadow ? map(seen.shadow) : Tensor());
  const Tensor squared = mean(square(image - truth));
  observed_ = {squared};
  Tensor total = squared * config_.weight_rgb;
  if (perceptual_) total = total + perceptual_loss(*perceptual_, image, truth) * config_.weight_perceptual;
  if (discriminator_) total = total + adversarial_loss(image, truth);
  if (all > camera_rays) {
    const Tensor depth = slice(seen.depth, 0, camera_rays, all);
    const Tensor ranges =
        from_host(std::vector<float>(rays.ranges.begin() + camera_rays, rays.ranges.end()), {all - camera_rays});
    total = total + lidar_loss(depth, ranges) * config_.weight_lidar +
            mean(slice(seen.stray, 0, camera_rays, all)) * config_.weight_stray;
    observed_.push_back(mean(minimum(abs(stop_gradient(depth) - ranges), 1.f)));
  }
  if (seen.kl) total = total + seen.kl * config_.weight_kl;
  last_samples_ = seen.samples.t.dim(0);
  if (skim) lit_permille_ = 1000 * (last_samples_ + 1) / (seen.marched + 1);
  last_actors_ = seen.actors;
  met_codes_ = seen.codes;
  return total;
}

Gradients GenAssets::gradients(const Progress& progress, const Tensors& wanted) {
  if (prior_) prior_->begin_step(progress);
  Gradients step = config_.whole_images ? gradients_in_tiles(progress, wanted) : Method::gradients(progress, wanted);
  if (prior_) prior_->add(step, wanted, met_codes_, progress);
  met_codes_ = {};
  return step;
}

Tensors GenAssets::observed() const {
  Tensors out = observed_;
  const Tensors more = prior_ ? prior_->observed() : Tensors{};
  out.insert(out.end(), more.begin(), more.end());
  return out;
}

void GenAssets::after_step(const Progress& progress) {
  if (prior_) prior_->end_step(progress);
}

std::map<std::string, double> GenAssets::metrics() const {
  std::map<std::string, double> out = {{"samples", static_cast<double>(last_samples_)},
                                       {"actors", static_cast<double>(last_actors_)},
                                       {"lit", static_cast<double>(lit_permille_) / 1000}};
  if (!observed_.empty() && observed_[0].evaluated())
    out["psnr"] = -10 * std::log10(static_cast<double>(observed_[0].item()) + 1e-12);
  if (observed_.size() > 1 && observed_[1].evaluated()) out["lidar_m"] = static_cast<double>(observed_[1].item());
  if (prior_) out["prior"] = static_cast<double>(prior_->weight());
  return out;
}

}  // namespace cloam
