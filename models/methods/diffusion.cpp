// GenAssets, stage 2.
#include "models/methods/diffusion.h"

#include <algorithm>

#include "models/batches/own_rows.h"
#include "models/batches/row_source.h"
#include "models/diffusion/sampler.h"
#include "runtime/error.h"
#include "runtime/ops/random.h"

namespace cloam {
namespace {

// Streams of random numbers within a step, and of a generation.
enum Stream : uint32_t { kCodes = 0, kNoise = 1, kTimes = 2, kScoredCodes = 3, kScoredNoise = 4, kFittedCodes = 5 };

constexpr float kDecayStart = 0.3f;   // share of the steps before the rate falls
constexpr int kDiffusionWarmUp = 30;  // steps
constexpr int kScoredTimes = 16;      // at which a code's v-loss is measured
constexpr size_t kScoredCodesAtOnce = 64;

Tensor numbers(const std::vector<int32_t>& values) { return from_host(values, {static_cast<int64_t>(values.size())}); }

Shape shape_of(const DiffusionConfig& c, int64_t count) { return {count, c.channels, c.side, c.side}; }

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

/// Of the assets from the wish's first on: what they begin with, whatever others are made with them.
Tensor noise_for(const AssetRequest& wish, const Shape& shape) {
  return random_normal(shape, {wish.seed}, static_cast<uint64_t>(numel(shape) / shape[0] * wish.first / 4));
}

/// What v-loss is measured on at one time, as Gaussians take it: those of all codes at once, which share the work.
struct NoisyCodes {
  Eigen::MatrixXd noisy = {}, target = {};
  std::vector<int> classes = {}, nights = {};

  void add(const Tensor& some_noisy, const Tensor& some_target, const AssetCodes& codes,
           const std::vector<int32_t>& rows) {
    const Eigen::Index count = noisy.rows(), more = some_noisy.dim(0), width = some_noisy.numel() / more;
    noisy.conservativeResize(count + more, width);
    target.conservativeResize(count + more, width);
    noisy.bottomRows(more) = as_rows(some_noisy);
    target.bottomRows(more) = as_rows(some_target);
    for (const int32_t row : rows) {
      classes.push_back(codes.classes[static_cast<size_t>(row)]);
      nights.push_back(codes.nights[static_cast<size_t>(row)]);
    }
  }

  double loss(const CodeGaussians& gaussians, const Level& level) const {
    return (gaussians.velocity(noisy, classes, nights, level) - target).array().square().mean();
  }
};

}  // namespace

void Diffusion::configure(Config& c) {
  DiffusionConfig& o = config_;
  c.bind("code.channels", o.channels, "channels of a code (taken from the source run)", {1, 4096});
  c.bind("code.side", o.side, "side of a code (taken from the source run)", {1, 256});
  c.bind("unet.base", o.base, "channels of the U-Net at full resolution", {1, 4096});
  c.bind("unet.multipliers", o.multipliers, "channel multiplier of each U-Net level; each level halves the resolution");
  c.bind("unet.blocks", o.blocks, "residual blocks per level", {1, 64});
  c.bind("unet.groups", o.groups, "groups of the U-Net's group norms", {1, 4096});
  c.bind("beyond.wiener", o.wiener,
         "the U-Net adds to the Wiener denoiser of the training codes, which knows their means and covariance");
  c.bind("schedule.betas", o.betas, "noise schedule: linear, cosine or scaled-linear",
         {"linear", "cosine", "scaled-linear"});
  c.bind("schedule.timesteps", o.timesteps, "timesteps of the noise schedule", {2, 100000});
  c.bind("batch.codes", o.batch, "codes per step", {1, 1 << 20});
  c.bind("condition.drop", o.drop,
         "fraction of the codes trained without class and time of day (classifier-free guidance)", kShareBelowOne);
  c.bind("data.held_out", o.held_out, "fraction of the codes held out for evaluation", kShareBelowOne);
  c.bind("data.drawn", o.drawn, "sample each code from its own variance, if it has one; false: use the mean");
  c.bind("data.min_steps", o.min_steps, "leave out actors seen in fewer training steps than this", kStepsOrNone);
  c.bind("weight.min_snr", o.min_snr, "gamma of the min-SNR loss weights; 0: equal weights");
  c.bind(kMixedPrecision, o.half,
         "the U-Net keeps what its convolutions read in half precision: true with --precision mixed");
  c.bind("train.rate", o.rate, "learning rate");
  c.bind("train.final_rate", o.final_rate, "learning rate at the last step, as a fraction of train.rate");
  c.bind("train.ema", o.average, "decay of the EMA of the weights, which evaluation and sampling use", kShareBelowOne);
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
  o.half = config_.half;
  o.labels = asset_labels();
  std::optional<WienerStart> start;
  if (config_.wiener) start.emplace(int64_t{config_.channels} * config_.side * config_.side);
  network_ = std::make_unique<CodeNetwork>(o, NoiseSchedule(betas_named(config_.betas), config_.timesteps), seed,
                                           std::move(start));
  codes_ = std::make_unique<CodeSet>(config_.channels);
}

std::map<std::string, std::string> Diffusion::settings_from(const SourceRun& source) const {
  const CodeShape shape = cloam::code_shape(source);
  return {{"code.channels", std::to_string(shape.channels)}, {"code.side", std::to_string(shape.side)}};
}

void Diffusion::load(const SourceRun& source) {
  AssetCodes codes = asset_codes(source, config_.min_steps);
  if (!config_.drawn) codes.deviations.clear();
  if (codes.channels != config_.channels || codes.side != config_.side)
    throw Error(Fault::usage, text("the settings say codes of ", config_.channels, "x", config_.side, "x", config_.side,
                                   " (code.channels, code.side), those of ", source.folder.string(), " are ",
                                   codes.channels, "x", codes.side, "x", codes.side));
  if (codes.count() < 2)
    throw Error(Fault::data, text(source.folder.string(), " has one asset that was seen, want 2 or more: one of ",
                                  "them is held out\n  fix: learn from a run on more logs"));
  codes_->take(std::move(codes), config_.held_out, seed_);
  gaussians_.reset();
  if (network_->start() && !network_->start()->fitted()) network_->start()->fit(gaussians());
}

std::vector<std::string> Diffusion::warnings() const {
  const int64_t unseen = codes_->codes().unseen;
  if (unseen == 0) return {};
  return {text(unseen, " actors are left out: the run saw them in fewer than ", config_.min_steps,
               " of its steps (data.min_steps)")};
}

MemoryPlan Diffusion::memory(const PhotoSizes&) const {
  MemoryPlan plan = memory_of(network_->parameters());
  const uint64_t weights = plan.parameters;
  plan.parameters = 2 * weights;  // and their EMA
  int64_t kept = 0;               // numbers of a code that the gradient needs: some ten maps a residual block
  const int64_t maps = config_.half ? 9 : 10;  // two of them in half precision
  int64_t places = int64_t{config_.side} * config_.side;
  for (const int64_t by : whole_numbers("unet.multipliers", config_.multipliers)) {
    kept += maps * (2 * int64_t{config_.blocks} + 2) * config_.base * by * places;
    places /= 4;
  }
  plan.work = weights + 4 * static_cast<uint64_t>(kept * config_.batch);
  return plan;
}

ParameterGroups Diffusion::groups() const {
  return {{"", config_.rate, {config_.final_rate, kDecayStart, 0, kDiffusionWarmUp}}};
}

Step Diffusion::step(const Progress& progress, const Tensors& wanted) {
  const auto number = static_cast<uint32_t>(progress.step);
  const auto rows = [&](const Share& of) {
    return draw_rows(codes_->training(), config_.batch, HostRandom(seed_, number), of);
  };
  const RowBatch whole = rows({}), batch = rows(progress.share);
  const auto own = [&](const Tensor& all) { return own_rows(all, progress.share); };
  std::vector<bool> dropped;
  for (const float chance : batch.chances) dropped.push_back(chance < config_.drop);
  const NoiseSchedule& schedule = network_->schedule();
  const Tensor x = own(codes_->draw(whole.rows, {seed_, number, kCodes}));
  const Tensor noise = own(random_normal(shape_of(config_, config_.batch), {seed_, number, kNoise}));
  const Tensor t = own(random_below({config_.batch}, config_.timesteps, {seed_, number, kTimes}));
  const Tensor v = network_->velocity(CodeNetwork::Weights::trained, schedule.noisy(x, noise, t), t,
                                      codes_->condition_of(batch.rows, dropped));
  const Tensor errors = mean(square(v - schedule.target(Prediction::velocity, x, noise, t)), {{1, 2, 3}});
  const Tensor error = mean(errors);  // all timesteps alike
  const auto gamma = static_cast<double>(config_.min_snr);
  Step step =
      step_of(gamma > 0 ? mean(errors * schedule.min_snr_weights(Prediction::velocity, gamma, t)) : error, wanted);
  step.weight = static_cast<double>(batch.rows.size()) / config_.batch;
  step.figures = {{"v_loss", 0, error}};
  return step;
}

void Diffusion::after_step(const Progress& progress) {
  network_->average(static_cast<double>(config_.average), progress.step);
}

TensorMap Diffusion::state() const {
  TensorMap out = network_->state();
  out.merge(codes_->state());
  return out;
}

void Diffusion::restore(const TensorMap& state) {
  network_->restore(state);
  codes_->restore(state);
}

Diffusion::Loss Diffusion::v_loss(const std::vector<int32_t>& rows, const CodeGaussians* gaussians) const {
  const NoiseSchedule& schedule = network_->schedule();
  Loss sum;
  for (int i = 0; i < kScoredTimes; ++i) {
    const int32_t time = config_.timesteps * (2 * i + 1) / (2 * kScoredTimes);
    NoisyCodes all;
    for (size_t begin = 0; begin < rows.size(); begin += kScoredCodesAtOnce) {
      const std::vector<int32_t> some(
          rows.begin() + static_cast<std::ptrdiff_t>(begin),
          rows.begin() + static_cast<std::ptrdiff_t>(std::min(rows.size(), begin + kScoredCodesAtOnce)));
      const RandomKey key = {seed_, static_cast<uint32_t>(begin) * kScoredTimes + static_cast<uint32_t>(i), 0};
      const Tensor x = codes_->draw(some, {key.seed, key.step, kScoredCodes});
      const Tensor noise = random_normal(x.shape(), {key.seed, key.step, kScoredNoise});
      const Tensor t = numbers(std::vector<int32_t>(some.size(), time));
      const Tensor noisy = schedule.noisy(x, noise, t), target = schedule.target(Prediction::velocity, x, noise, t);
      const Tensor v = network_->velocity(CodeNetwork::Weights::averaged, noisy, t, codes_->condition_of(some));
      const Tensor of_network = mean(square(v - target)), of_zero = mean(square(target));
      const Tensor floor = codes_->floor_of(some, schedule.level(time));
      eval({of_network, of_zero, floor});
      const double weight = static_cast<double>(some.size()) / (static_cast<double>(rows.size()) * kScoredTimes);
      sum.of_network += weight * static_cast<double>(of_network.item());
      sum.of_zero += weight * static_cast<double>(of_zero.item());
      sum.floor += weight * static_cast<double>(floor.item());
      if (gaussians) all.add(noisy, target, codes_->codes(), some);
    }
    if (gaussians) sum.of_gaussians += all.loss(*gaussians, schedule.level(time)) / kScoredTimes;
  }
  return sum;
}

const CodeGaussians& Diffusion::gaussians() {
  if (gaussians_) return *gaussians_;
  const CodeTable table = codes_->table(codes_->training(), {seed_, 0, kFittedCodes});
  gaussians_ = std::make_unique<CodeGaussians>(table, likeliest_shrinkage(table, seed_));
  return *gaussians_;
}

CodeDenoiser Diffusion::denoiser() const {
  CodeDenoiser out{network_->schedule(), config_.side, codes_->mean(), codes_->deviation(), {}, {}};
  out.clean = [this](const Tensor& noisy, const std::vector<int32_t>& times, const Condition& condition) {
    const Tensor t = numbers(times);
    return network_->schedule().clean(noisy, network_->velocity(CodeNetwork::Weights::averaged, noisy, t, condition),
                                      t);
  };
  out.examples = [this](int32_t asset_class, int32_t night) { return codes_->examples(asset_class, night); };
  return out;
}

PriorScore Diffusion::score() {
  const Loss unseen = v_loss(codes_->held_out(), &gaussians());
  PriorScore score;
  score.codes = static_cast<int64_t>(codes_->held_out().size());
  score.training_codes = static_cast<int64_t>(codes_->training().size());
  score.v_loss = unseen.of_network;
  score.zero_v_loss = unseen.of_zero;
  score.floor_v_loss = unseen.floor;
  score.wiener_v_loss = unseen.of_gaussians;
  score.training_v_loss = v_loss(codes_->training(), nullptr).of_network;
  score.shrinkage = gaussians().shrinkage();
  return score;
}

Tensor Diffusion::sampled(const AssetRequest& wish, const std::vector<NewAsset>& assets) const {
  std::vector<int32_t> classes, nights;
  for (const NewAsset& asset : assets) {
    classes.push_back(asset.asset_class);
    nights.push_back(asset.night ? 1 : 0);
  }
  const auto count = static_cast<int64_t>(assets.size());
  const auto network = [&](const Condition& condition) {
    return [this, condition, count](const Tensor& noisy, int64_t time) {
      const Tensor t = numbers(std::vector<int32_t>(static_cast<size_t>(count), static_cast<int32_t>(time)));
      return network_->velocity(CodeNetwork::Weights::averaged, noisy, t, condition);
    };
  };
  const Denoiser with = network(asset_condition(classes, nights));
  const Denoiser without = network(asset_condition(std::vector<int32_t>(assets.size(), kAssetClassCount),
                                                   std::vector<int32_t>(assets.size(), kTimesOfDay)));
  SamplerOptions options;
  options.steps = wish.steps;
  return sample(network_->schedule(), Prediction::velocity, guided(with, without, wish.guidance),
                noise_for(wish, shape_of(config_, count)), options);
}

Tensor Diffusion::codes_for(const AssetRequest& wish, const std::vector<NewAsset>& assets) {
  const Shape shape = shape_of(config_, static_cast<int64_t>(assets.size()));
  if (wish.codes == CodeSource::sampled) return sampled(wish, assets);
  if (wish.codes == CodeSource::random) return noise_for(wish, shape);
  std::vector<float> values;
  for (size_t i = 0; i < assets.size(); ++i) {
    const auto [asset_class, night] = std::pair(assets[i].asset_class, assets[i].night);
    const bool is_mean = wish.codes == CodeSource::mean;
    const Eigen::VectorXd code =
        is_mean ? gaussians().mean(asset_class, night)
                : gaussians().sample(asset_class, night, wish.seed, static_cast<size_t>(wish.first) + i);
    for (const double value : code) values.push_back(static_cast<float>(value));
  }
  return from_host(values, shape);
}

std::vector<NewAsset> Diffusion::generate(const AssetRequest& wish) {
  const AssetCodes& known = codes_->codes();
  const auto fits = [&](int32_t row) { return (known.nights[static_cast<size_t>(row)] == 1) == *wish.night; };
  if (wish.night && std::none_of(codes_->training().begin(), codes_->training().end(), fits))
    throw Error(Fault::usage, text("no actor seen by ", *wish.night ? "night" : "day", " was in the training set"));
  if (wish.codes == CodeSource::training) return codes_->training_assets(wish);
  std::vector<NewAsset> assets;
  for (int i = 0; i < wish.count; ++i) {
    const auto like = static_cast<size_t>(codes_->drawn_actor(wish, static_cast<uint64_t>(wish.first + i)));
    NewAsset asset;
    asset.asset_class = wish.asset_class.value_or(known.classes[like]);
    asset.night = wish.night.value_or(known.nights[like] == 1);
    assets.push_back(asset);
  }
  const std::vector<float> values =
      (codes_for(wish, assets) * by_channel(codes_->deviation()) + by_channel(codes_->mean())).to_host();
  const size_t numbers = values.size() / assets.size();
  for (size_t i = 0; i < assets.size(); ++i) {
    assets[i].code.assign(values.begin() + static_cast<std::ptrdiff_t>(i * numbers),
                          values.begin() + static_cast<std::ptrdiff_t>((i + 1) * numbers));
    assets[i].size = codes_->nearest_size(assets[i].code, assets[i].asset_class);
  }
  return assets;
}

}  // namespace cloam
