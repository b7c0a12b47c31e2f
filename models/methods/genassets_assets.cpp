// GenAssets' actors: which of them rays meet, and from codes to tri-planes.
#include "models/methods/code_denoising.h"
#include "models/methods/genassets.h"
#include "runtime/error.h"
#include "runtime/ops/street.h"

namespace cloam {

int64_t GenAssets::planes_side() const {
  return int64_t{config_.code_side} << (whole_numbers("decoder.widths", config_.decoder_widths).size() - 1);
}

/// [N, ...] rows of the codes (or planes) of assets, which may be of several logs.
Tensor GenAssets::asset_rows(const std::vector<AssetPlace>& assets) const {
  Tensors parts;
  for (size_t begin = 0, end = 0; begin < assets.size(); begin = end) {
    std::vector<int32_t> rows;
    for (; end < assets.size() && assets[end].log == assets[begin].log; ++end)
      rows.push_back(static_cast<int32_t>(assets[end].actor));
    const Log& log = logs_[assets[begin].log];
    const Tensor own = gather_rows(log.assets, from_host(rows, {static_cast<int64_t>(rows.size())}));
    parts.push_back(log.common_code ? own + log.common_code : own);
  }
  return parts.size() == 1 ? parts.front() : concat(parts, 0);
}

UnetCondition GenAssets::condition_of(const std::vector<AssetPlace>& assets) const {
  std::vector<int32_t> classes, nights;
  for (const AssetPlace& asset : assets) {
    classes.push_back(logs_[asset.log].classes[asset.actor]);
    nights.push_back(logs_[asset.log].scene.night ? 1 : 0);
  }
  const auto count = static_cast<int64_t>(assets.size());
  return {from_host(classes, {count}), from_host(nights, {count})};
}

GenAssets::Decoded GenAssets::decode(const std::vector<AssetPlace>& assets, const Drawing& how) const {
  const auto count = static_cast<int64_t>(assets.size());
  const int64_t side = planes_side(), channels = config_.field.plane_channels;
  const Tensor rows = asset_rows(assets);
  if (!decoder_) return {permute(reshape(rows, {count, 3, side, side, channels}), {1, 0, 2, 3, 4}), {}, {}};
  Decoded out;
  Tensor code = rows, mean_code = rows;
  if (config_.variational) {
    const int64_t numbers = rows.dim(1) / 2;
    const Tensor log_variance = slice(rows, 1, numbers, 2 * numbers) + kCodeLogVariance;
    code = mean_code = slice(rows, 1, 0, numbers);
    if (how.random) code = mean_code + exp(log_variance * 0.5f) * random_normal({count, numbers}, how.of(kCodes));
    const Tensor terms = square(mean_code) + exp(log_variance) - 1.f - log_variance;
    out.kl = mean(terms) * 0.5f;
  }
  const Shape shape = {count, config_.code_channels, config_.code_side, config_.code_side};
  const UnetCondition condition = condition_of(assets);
  const Tensor planes = (*decoder_)(reshape(code, shape), condition.class_id);
  out.codes = {reshape(mean_code, shape), condition};
  out.planes = permute(reshape(planes, {count, 3, channels, side, side}), {1, 0, 3, 4, 2});
  return out;
}

GenAssets::Decoded GenAssets::decode_met(const Met& met, const Drawing& how) const {
  if (met.assets.empty()) return {};
  Decoded out = decode(met.assets, how);
  out.slots = from_host(met.slot_of, {static_cast<int64_t>(met.slot_of.size())});
  return out;
}

/// Actors that rays meet get slots: only they are decoded.
GenAssets::Met GenAssets::meet(const Stage& stage, const StreetSamples& s) const {
  Met met;
  met.slot_of.assign(stage.looks.size() + 1, -1);
  for (const Tensor& owners : {s.owners, s.shadow_owners})
    if (owners.dim(0) > 0)
      for (const int32_t owner : owners.to_host<int32_t>()) met.slot_of[static_cast<size_t>(owner)] = 0;
  for (size_t a = 0; a < stage.looks.size(); ++a)
    if (met.slot_of[a] == 0) {
      met.slot_of[a] = static_cast<int32_t>(met.assets.size());
      met.assets.push_back(stage.looks[a]);
    }
  return met;
}

void GenAssets::adopt_prior(const CodeDenoiser& denoiser) {
  if (!decoder_)
    throw Error(Fault::usage,
                "--prior: the run learns its actors' planes directly (decoder.use = false): it has no codes");
  const auto channels = static_cast<int64_t>(denoiser.mean.size());
  if (channels != config_.code_channels || denoiser.side != config_.code_side)
    throw Error(Fault::usage, text("--prior: it knows codes of ", channels, "x", denoiser.side, "x", denoiser.side,
                                   ", the settings say ", config_.code_channels, "x", config_.code_side, "x",
                                   config_.code_side, " (code.channels, code.side)"));
  prior_ = std::make_unique<CodePrior>(denoiser, config_.prior, seed_);
}

/// A street that one image alone tells of begins with the prior: it has seen the sides that the image does not show.
void GenAssets::denoise_image() {
  if (!prior_ || logs_.size() != 1 || logs_.front().data->images() != 1) return;
  const Log& log = logs_.front();
  RayList rays;
  HostRandom random(0, 0);
  (void)log.data->add_image(rays, *log.space, random);
  CodeRows codes = {log.assets, log.common_code, {}, {}};
  std::vector<AssetPlace> assets;
  for (size_t a = 0; a < rays.actors.size(); ++a)
    if (rays.actors[a]) {
      codes.rows.push_back(static_cast<int32_t>(a));
      assets.push_back({0, a});
    }
  if (assets.empty()) return;
  codes.condition = condition_of(assets);
  prior_->denoise(std::move(codes));
}

}  // namespace cloam
