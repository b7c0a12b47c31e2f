// GenAssets, stage 2.
#include "models/methods/diffusion.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "models/diffusion/sampler.h"
#include "models/io/host_random.h"
#include "models/io/tensors.h"
#include "models/nn/ema.h"
#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

// Streams of random numbers within a step, and of a generation.
enum Stream : uint32_t { kCodes = 0, kNoise = 1, kTimes = 2, kScoredCodes = 3, kScoredNoise = 4 };

constexpr int64_t kNetworkTimes = 1000;  // the scale of times that the U-Net's encoding is made for
constexpr float kDecayStart = 0.3f;      // share of the steps before the rate falls
constexpr int kWarmUp = 30;              // steps
constexpr int kScoredTimes = 16;         // at which a code's v-loss is measured
constexpr size_t kScoredCodesAtOnce = 64;
constexpr float kLeastDeviation = 1e-6f;

Tensor numbers(const std::vector<int32_t>& values) { return from_host(values, {static_cast<int64_t>(values.size())}); }

void check(const DiffusionConfig& c) {
  const std::vector<int64_t> multipliers = whole_numbers("unet.multipliers", c.multipliers);
  const int64_t step = int64_t{1} << std::min<size_t>(multipliers.size() - 1, 20);
  if (c.side % step != 0)
    throw Error(Fault::usage, text("setting unet.multipliers: ", c.multipliers, " halves the codes to 1/", step,
                                   " of their side, which is ", c.side));
  for (const int64_t by : multipliers)
    if (c.base % 4 != 0 || c.base * by % c.groups != 0)
      throw Error(Fault::usage, text("setting unet.base is ", c.base, ", want a multiple of 4 that gives widths which ",
                                     c.groups, " groups (unet.groups) divide"));
}

}  // namespace

void Diffusion::configure(Config& c) {
  c.bind("code.channels", config_.channels, "channels of a code (taken from the source run)", {1, 4096});
  c.bind("code.side", config_.side, "side of a code (taken from the source run)", {1, 256});
  c.bind("unet.base", config_.base, "channels of the U-Net at full resolution", {1, 4096});
  c.bind("unet.multipliers", config_.multipliers,
         "channel multiplier of each U-Net level; each level halves the resolution");
  c.bind("unet.blocks", config_.blocks, "residual blocks per level", {1, 64});
  c.bind("unet.groups", config_.groups, "groups of the U-Net's group norms", {1, 4096});
  c.bind("schedule.betas", config_.betas, "noise schedule: linear, cosine or scaled-linear");
  c.bind("schedule.timesteps", config_.times, "timesteps of the noise schedule", {2, 100000});
  c.bind("batch.codes", config_.batch, "codes per step", {1, 1 << 20});
  c.bind("condition.drop", config_.drop,
         "fraction of the codes trained without class and time of day (classifier-free guidance)", kShareBelowOne);
  c.bind("data.held_out", config_.held_out, "fraction of the codes held out for evaluation", kShareBelowOne);
  c.bind("data.drawn", config_.drawn, "sample each code from its own variance, if it has one; false: use the mean");
  c.bind("data.min_steps", config_.least_steps, "leave out actors seen in fewer training steps than this",
         {0, 1 << 30});
  c.bind("weight.min_snr", config_.min_snr, "gamma of the min-SNR loss weights; 0: equal weights", kFromZero);
  c.bind("train.rate", config_.rate, "learning rate", kFromZero);
  c.bind("train.final_rate", config_.final_rate, "learning rate at the last step, as a fraction of train.rate",
         kFromZero);
  c.bind("train.ema", config_.average, "decay of the EMA of the weights, which evaluation and sampling use",
         kShareBelowOne);
}

void Diffusion::build(const Scenes&, uint64_t seed) {
  check(config_);
  seed_ = seed;
  UnetOptions o;
  o.channels = config_.channels;
  o.base = config_.base;
  o.multipliers = whole_numbers("unet.multipliers", config_.multipliers);
  o.blocks = config_.blocks;
  o.groups = config_.groups;
  o.labels = asset_labels();
  schedule_.emplace(betas_named(config_.betas), config_.times);
  unet_ = std::make_unique<Unet>(Scope{params_, "unet", seed}, o);
  ema_unet_ = std::make_unique<Unet>(Scope{ema_, "unet", seed}, o);  // begins as the network itself
  mean_.assign(static_cast<size_t>(config_.channels), 0.f);
  deviation_.assign(static_cast<size_t>(config_.channels), 1.f);
}

std::map<std::string, std::string> Diffusion::settings_from(const SourceRun& source) const {
  const CodeShape shape = cloam::code_shape(source);
  return {{"code.channels", std::to_string(shape.channels)}, {"code.side", std::to_string(shape.side)}};
}

void Diffusion::load(const SourceRun& source) {
  codes_ = asset_codes(source, config_.least_steps);
  if (!config_.drawn) codes_.deviations.clear();
  if (codes_.channels != config_.channels || codes_.side != config_.side)
    throw Error(Fault::usage, text("the settings say codes of ", config_.channels, "x", config_.side, "x", config_.side,
                                   " (code.channels, code.side), those of ", source.folder.string(), " are ",
                                   codes_.channels, "x", codes_.side, "x", codes_.side));
  if (codes_.count() < 2)
    throw Error(Fault::data, text(source.folder.string(), " has one asset that was seen, want 2 or more: one of ",
                                  "them is held out\n  fix: learn from a run on more logs"));
  split();
  standardise();
}

/// In an order that the seed shuffles, the first are held out; each part keeps the order of the run.
void Diffusion::split() {
  HostRandom random(seed_, 0);
  std::vector<int32_t> order(codes_.count());
  for (size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int32_t>(i);
  for (size_t i = order.size() - 1; i > 0; --i) std::swap(order[i], order[random.below(i + 1)]);
  const auto share = std::lround(config_.held_out * static_cast<float>(order.size()));
  const size_t count = std::clamp<size_t>(static_cast<size_t>(share), 1, order.size() - 1);
  const auto end = order.begin() + static_cast<std::ptrdiff_t>(count);
  held_out_.assign(order.begin(), end);
  training_.assign(end, order.end());
  std::sort(held_out_.begin(), held_out_.end());
  std::sort(training_.begin(), training_.end());
}

/// Mean 0 and variance 1 a channel of what is drawn of the training codes, their own variance included.
void Diffusion::standardise() {
  const size_t channels = mean_.size(), places = static_cast<size_t>(codes_.side * codes_.side);
  const double count = static_cast<double>(training_.size() * places);
  const bool drawn = !codes_.deviations.empty();
  for (size_t c = 0; c < channels; ++c) {
    const auto over_training = [&](const auto& figure) {
      double sum = 0;
      for (const int32_t row : training_)
        for (size_t p = 0; p < places; ++p) sum += figure((static_cast<size_t>(row) * channels + c) * places + p);
      return sum / count;
    };
    const double mean = over_training([&](size_t i) { return static_cast<double>(codes_.means[i]); });
    const double variance = over_training([&](size_t i) {
      const double own = drawn ? static_cast<double>(codes_.deviations[i]) : 0;
      return std::pow(static_cast<double>(codes_.means[i]) - mean, 2) + own * own;
    });
    mean_[c] = static_cast<float>(mean);
    deviation_[c] = std::max(kLeastDeviation, static_cast<float>(std::sqrt(variance)));
  }
  const Shape shape = shape_of(static_cast<int64_t>(codes_.count()));
  means_ = (from_host(codes_.means, shape) - by_channel(mean_)) / by_channel(deviation_);
  deviations_ = drawn ? from_host(codes_.deviations, shape) / by_channel(deviation_) : Tensor();
  eval(drawn ? Tensors{means_, deviations_} : Tensors{means_});
}

std::vector<std::string> Diffusion::describe() const {
  std::map<int32_t, int64_t> classes;
  for (const int32_t one : codes_.classes) classes[one]++;
  std::string kinds;
  for (const auto& [one, count] : classes) kinds += text(kinds.empty() ? "" : ", ", kAssetClasses[one], " ", count);
  const auto nights = std::count(codes_.nights.begin(), codes_.nights.end(), 1);
  return {text(codes_.count(), " codes of ", codes_.channels, "x", codes_.side, "x", codes_.side,
               deviations_ ? " with variance, " : " without variance, ", held_out_.size(), " held out"),
          text(kinds, "; ", nights, " at night")};
}

std::vector<std::string> Diffusion::warnings() const {
  if (codes_.unseen == 0) return {};
  return {text(codes_.unseen, " actors are left out: the run saw them in fewer than ", config_.least_steps,
               " of its steps (data.min_steps)")};
}

MemoryPlan Diffusion::memory(const PhotoSizes&) const {
  MemoryPlan plan = memory_of(params_);
  const uint64_t weights = plan.parameters;
  plan.parameters = 2 * weights;  // and their EMA
  int64_t kept = 0;               // numbers of a code that the gradient needs: some ten maps a residual block
  int64_t places = int64_t{config_.side} * config_.side;
  for (const int64_t by : whole_numbers("unet.multipliers", config_.multipliers)) {
    kept += 10 * (2 * int64_t{config_.blocks} + 2) * config_.base * by * places;
    places /= 4;
  }
  plan.work = weights + 4 * static_cast<uint64_t>(kept * config_.batch);
  return plan;
}

ParameterGroups Diffusion::groups() const {
  return {{"", config_.rate, {config_.final_rate, kDecayStart, 0, kWarmUp}}};
}

Tensor Diffusion::draw(const std::vector<int32_t>& rows, const RandomKey& key) const {
  const Tensor at = numbers(rows), mean = gather_rows(means_, at);
  return deviations_ ? mean + gather_rows(deviations_, at) * random_normal(mean.shape(), key) : mean;
}

/// dropped: of each row; empty: none.
Condition Diffusion::condition_of(const std::vector<int32_t>& rows, const std::vector<bool>& dropped) const {
  std::vector<int32_t> classes, nights;
  for (size_t i = 0; i < rows.size(); ++i) {
    const auto row = static_cast<size_t>(rows[i]);
    const bool drop = !dropped.empty() && dropped[i];
    classes.push_back(drop ? kAssetClassCount : codes_.classes[row]);
    nights.push_back(drop ? kTimesOfDay : codes_.nights[row]);
  }
  return asset_condition(classes, nights);
}

Tensor Diffusion::predict(const Unet& unet, const Tensor& noisy, const Tensor& t, const Condition& condition) const {
  const float scale = static_cast<float>(kNetworkTimes) / static_cast<float>(config_.times);
  return unet(noisy, cast(t, DType::f32) * scale, condition);
}

Step Diffusion::step(const Progress& progress, const Tensors& wanted) {
  HostRandom random(seed_, static_cast<uint64_t>(progress.step));
  const auto number = static_cast<uint32_t>(progress.step);
  std::vector<int32_t> rows;
  std::vector<bool> dropped;
  for (int i = 0; i < config_.batch; ++i) {
    rows.push_back(training_[random.below(training_.size())]);
    dropped.push_back(random.uniform() < config_.drop);
  }
  const Tensor x = draw(rows, {seed_, number, kCodes}), noise = random_normal(x.shape(), {seed_, number, kNoise});
  const Tensor t = random_below({config_.batch}, config_.times, {seed_, number, kTimes});
  const Tensor v = predict(*unet_, schedule_->noisy(x, noise, t), t, condition_of(rows, dropped));
  const Tensor errors = mean(square(v - schedule_->target(Prediction::velocity, x, noise, t)), {{1, 2, 3}});
  const Tensor error = mean(errors);  // all timesteps alike
  const auto gamma = static_cast<double>(config_.min_snr);
  Step step =
      step_of(gamma > 0 ? mean(errors * schedule_->min_snr_weights(Prediction::velocity, gamma, t)) : error, wanted);
  step.figures = {{"v_loss", 0, error}};
  return step;
}

void Diffusion::after_step(const Progress& progress) {
  update_ema(ema_, params_, warm_decay(static_cast<double>(config_.average), progress.step));
}

TensorMap Diffusion::state() const {
  TensorMap out;
  for (const auto& [name, mean] : ema_) out["ema." + name] = named(mean);
  out["mean"] = named(from_host(mean_, {config_.channels}));
  out["deviation"] = named(from_host(deviation_, {config_.channels}));
  return out;
}

void Diffusion::restore(const TensorMap& state) {
  std::vector<std::pair<Tensor, Tensor>> updates;
  for (const auto& [name, mean] : ema_) updates.push_back({mean, tensor_from(state, "ema." + name, mean.shape())});
  assign(updates);
  mean_ = tensor_from(state, "mean", {config_.channels}).to_host();
  deviation_ = tensor_from(state, "deviation", {config_.channels}).to_host();
}

Tensor Diffusion::floor_of(const std::vector<int32_t>& rows, const Level& level) const {
  if (!deviations_) return zeros({1});
  const Tensor variance = square(gather_rows(deviations_, numbers(rows)));
  return mean(variance / (variance * (level.alpha * level.alpha) + level.sigma * level.sigma));
}

Diffusion::Loss Diffusion::v_loss(const std::vector<int32_t>& rows) const {
  Loss sum;
  for (size_t begin = 0; begin < rows.size(); begin += kScoredCodesAtOnce) {
    const std::vector<int32_t> some(
        rows.begin() + static_cast<std::ptrdiff_t>(begin),
        rows.begin() + static_cast<std::ptrdiff_t>(std::min(rows.size(), begin + kScoredCodesAtOnce)));
    for (int i = 0; i < kScoredTimes; ++i) {
      const RandomKey key = {seed_, static_cast<uint32_t>(begin) * kScoredTimes + static_cast<uint32_t>(i), 0};
      const Tensor x = draw(some, {key.seed, key.step, kScoredCodes});
      const Tensor noise = random_normal(x.shape(), {key.seed, key.step, kScoredNoise});
      const int32_t time = config_.times * (2 * i + 1) / (2 * kScoredTimes);
      const Tensor t = numbers(std::vector<int32_t>(some.size(), time));
      const Tensor v = predict(*ema_unet_, schedule_->noisy(x, noise, t), t, condition_of(some, {}));
      const Tensor target = schedule_->target(Prediction::velocity, x, noise, t);
      const Tensor of_network = mean(square(v - target)), of_zero = mean(square(target));
      const Tensor floor = floor_of(some, schedule_->level(time));
      eval({of_network, of_zero, floor});
      const double weight = static_cast<double>(some.size()) / (static_cast<double>(rows.size()) * kScoredTimes);
      sum.of_network += weight * static_cast<double>(of_network.item());
      sum.of_zero += weight * static_cast<double>(of_zero.item());
      sum.floor += weight * static_cast<double>(floor.item());
    }
  }
  return sum;
}

CodeDenoiser Diffusion::denoiser() const {
  CodeDenoiser out{*schedule_, config_.side, mean_, deviation_, {}};
  out.clean = [this](const Tensor& noisy, const std::vector<int32_t>& times, const Condition& condition) {
    const Tensor t = numbers(times);
    return schedule_->clean(noisy, predict(*ema_unet_, noisy, t, condition), t);
  };
  return out;
}

PriorScore Diffusion::score() {
  const Loss unseen = v_loss(held_out_);
  return {static_cast<int64_t>(held_out_.size()),
          static_cast<int64_t>(training_.size()),
          unseen.of_network,
          unseen.of_zero,
          unseen.floor,
          v_loss(training_).of_network};
}

/// A training actor, whose class and time of day are taken where the wish leaves them open.
int32_t Diffusion::drawn_actor(const AssetWish& wish, uint64_t index) const {
  std::vector<int32_t> fitting, of_class;
  for (const int32_t row : training_) {
    const auto at = static_cast<size_t>(row);
    if (wish.asset_class && codes_.classes[at] != *wish.asset_class) continue;
    of_class.push_back(row);
    if (!wish.night || (codes_.nights[at] == 1) == *wish.night) fitting.push_back(row);
  }
  if (of_class.empty())
    throw Error(Fault::usage,
                text("no ", kAssetClasses[*wish.asset_class], " was in the training set; it had ", describe().back()));
  HostRandom random(wish.seed, index);
  // Both may be wished for though no training actor is both.
  const std::vector<int32_t>& from = fitting.empty() ? of_class : fitting;
  return from[random.below(from.size())];
}

Eigen::Vector3d Diffusion::nearest_size(const std::vector<float>& code, int asset_class) const {
  const size_t places = code.size() / deviation_.size();
  double least = std::numeric_limits<double>::infinity();
  Eigen::Vector3d size = Eigen::Vector3d::Zero();
  for (const int32_t row : training_) {
    const auto at = static_cast<size_t>(row);
    if (codes_.classes[at] != asset_class) continue;
    double apart = 0;
    for (size_t i = 0; i < code.size(); ++i)
      apart += std::pow(double{code[i] - codes_.means[at * code.size() + i]} / double{deviation_[i / places]}, 2);
    if (apart < least) least = apart, size = codes_.sizes[at];
  }
  return size;
}

Tensor Diffusion::sampled(const AssetWish& wish, const std::vector<NewAsset>& assets) const {
  std::vector<int32_t> classes, nights;
  for (const NewAsset& asset : assets) {
    classes.push_back(asset.asset_class);
    nights.push_back(asset.night ? 1 : 0);
  }
  const auto count = static_cast<int64_t>(assets.size());
  const auto network = [&](const Condition& condition) {
    return [this, condition, count](const Tensor& noisy, int64_t time) {
      const Tensor t = numbers(std::vector<int32_t>(static_cast<size_t>(count), static_cast<int32_t>(time)));
      return predict(*ema_unet_, noisy, t, condition);
    };
  };
  const Denoiser with = network(asset_condition(classes, nights));
  const Denoiser without = network(asset_condition(std::vector<int32_t>(assets.size(), kAssetClassCount),
                                                   std::vector<int32_t>(assets.size(), kTimesOfDay)));
  SamplerOptions options;
  options.steps = wish.steps;
  return sample(*schedule_, Prediction::velocity, guided(with, without, wish.guidance),
                random_normal(shape_of(count), {wish.seed}), options);
}

std::vector<NewAsset> Diffusion::training_assets(const AssetWish& wish) const {
  std::vector<NewAsset> assets;
  const auto numbers = static_cast<std::ptrdiff_t>(codes_.means.size() / codes_.count());
  for (const int32_t row : training_) {
    const auto at = static_cast<size_t>(row);
    const NewAsset asset{codes_.classes[at], codes_.nights[at] == 1, codes_.sizes[at], {}};
    if (asset.asset_class != wish.asset_class.value_or(asset.asset_class)) continue;
    if (asset.night != wish.night.value_or(asset.night)) continue;
    if (static_cast<int>(assets.size()) == wish.count) break;
    assets.push_back(asset);
    assets.back().code.assign(codes_.means.begin() + row * numbers, codes_.means.begin() + (row + 1) * numbers);
  }
  if (!assets.empty()) return assets;
  throw Error(Fault::usage, text("no such actor was in the training set; it had ", describe().back()));
}

std::vector<NewAsset> Diffusion::generate(const AssetWish& wish) {
  if (wish.night && std::none_of(training_.begin(), training_.end(), [&](int32_t row) {
        return (codes_.nights[static_cast<size_t>(row)] == 1) == *wish.night;
      }))
    throw Error(Fault::usage, text("no actor seen by ", *wish.night ? "night" : "day", " was in the training set"));
  if (wish.codes == CodeSource::training) return training_assets(wish);
  std::vector<NewAsset> assets;
  for (int i = 0; i < wish.count; ++i) {
    const auto like = static_cast<size_t>(drawn_actor(wish, static_cast<uint64_t>(i)));
    NewAsset asset;
    asset.asset_class = wish.asset_class.value_or(codes_.classes[like]);
    asset.night = wish.night.value_or(codes_.nights[like] == 1);
    assets.push_back(asset);
  }
  const Tensor codes =
      wish.codes == CodeSource::random ? random_normal(shape_of(wish.count), {wish.seed}) : sampled(wish, assets);
  const std::vector<float> values = (codes * by_channel(deviation_) + by_channel(mean_)).to_host();
  const size_t numbers = values.size() / assets.size();
  for (size_t i = 0; i < assets.size(); ++i) {
    assets[i].code.assign(values.begin() + static_cast<std::ptrdiff_t>(i * numbers),
                          values.begin() + static_cast<std::ptrdiff_t>((i + 1) * numbers));
    assets[i].size = nearest_size(assets[i].code, assets[i].asset_class);
  }
  return assets;
}

}  // namespace cloam
