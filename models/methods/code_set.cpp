// See code_set.h.
#include "models/methods/code_set.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "models/io/host_random.h"
#include "models/io/tensors.h"
#include "models/methods/genassets_model.h"
#include "models/scene/asset_class.h"
#include "models/train/old_names.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr float kMinDeviation = 1e-6f;

Tensor as_tensor(const std::vector<int32_t>& values) {
  return from_host(values, {static_cast<int64_t>(values.size())});
}

constexpr int64_t kLargest = 1 << 14;  // channels and side of a code
constexpr char kMethod[] = "genassets";
constexpr char kFix[] = "\n  fix: cloam train genassets LOG... --preset genassets-small -o RUN, and name that run";

/// As the run has it, or the default.
std::string setting(const SourceRun& source, const std::string& key, const std::string& otherwise) {
  const auto found = source.settings.find(key);
  return found == source.settings.end() ? otherwise : found->second;
}

int64_t extent(const SourceRun& source, const std::string& key, int otherwise) {
  const std::string value = setting(source, key, std::to_string(otherwise));
  int64_t number = 0;
  std::from_chars(value.data(), value.data() + value.size(), number);
  if (number >= 1 && number <= kLargest) return number;
  throw Error(Fault::data,
              text(source.folder.string(), ": its setting ", key, " is ", value, ", want 1 to ", kLargest));
}

/// The actors of one log, added to `codes`.
void add_log(AssetCodes& codes, const SourceRun& source, size_t log, bool variational, int64_t min_steps) {
  const Scene& scene = source.scenes[log];
  const auto actors = static_cast<int64_t>(scene.actors.size()), numbers = codes.channels * codes.side * codes.side;
  if (actors == 0) return;
  const std::string name = text("log", log, ".codes"), common = text("log", log, ".common.code");
  if (source.parameters.contains(common))
    throw Error(Fault::data, text(source.folder.string(),
                                  ": it was trained by an earlier version, whose codes are not "
                                  "whole without ",
                                  common, kFix));
  const int64_t width = numbers * (variational ? 2 : 1);
  const auto rows = values_from<float>(source.parameters, name, {actors, width});
  const auto steps = values_from<int32_t>(source.row_steps, name, {actors});
  for (size_t a = 0; a < scene.actors.size(); ++a) {
    if (steps[a] < min_steps) {
      codes.unseen++;
      continue;
    }
    for (int64_t i = 0; i < width; ++i) {
      const float value = rows[a * static_cast<size_t>(width) + static_cast<size_t>(i)];
      if (i < numbers)
        codes.means.push_back(value);
      else
        codes.deviations.push_back(std::exp(0.5f * (value + kCodeLogVariance)));
    }
    codes.classes.push_back(asset_class(scene.actors[a].label));
    codes.nights.push_back(scene.night ? 1 : 0);
    codes.sizes.push_back(scene.actors[a].size);
  }
}

}  // namespace

CodeShape code_shape(const SourceRun& source) {
  if (source.method != kMethod)
    throw Error(Fault::data,
                text("the run's method is ", source.method, ", whose scenes have no assets; want ", kMethod, kFix));
  if (source.edited_from)
    throw Error(Fault::data, text("the run is edited: its actors may have the appearance of others\n  fix: name ",
                                  *source.edited_from, ", which it was made from"));
  for (const auto& [key, value] : source.settings) (void)is_gone(key, value, source.folder.string());
  if (setting(source, "decoder.use", "true") != "true")
    throw Error(Fault::data, text("the run learned its actors' planes directly (decoder.use = false): there are no "
                                  "codes to learn from",
                                  kFix));
  return {extent(source, "code.channels", StreetModelOptions().code_channels),
          extent(source, "code.side", StreetModelOptions().code_side),
          setting(source, "code.variational", "true") == "true"};
}

AssetCodes asset_codes(const SourceRun& source, int64_t min_steps) {
  const CodeShape shape = code_shape(source);
  AssetCodes codes;
  codes.channels = shape.channels;
  codes.side = shape.side;
  for (size_t log = 0; log < source.scenes.size(); ++log) add_log(codes, source, log, shape.variational, min_steps);
  if (codes.count() > 0) return codes;
  throw Error(Fault::data, text(source.folder.string(), " has no actor to learn from: of ", codes.unseen,
                                " in its logs none was seen in ", min_steps, " steps of its training", kFix));
}

Eigen::MatrixXd as_rows(const Tensor& codes) {
  const std::vector<float> values = codes.to_host();
  using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return Eigen::Map<const Rows>(values.data(), codes.dim(0), codes.numel() / codes.dim(0)).cast<double>();
}

CodeSet::CodeSet(int64_t channels)
    : mean_(static_cast<size_t>(channels), 0.f), deviation_(static_cast<size_t>(channels), 1.f) {}

/// In an order that the seed shuffles, the first are held out; each part keeps the order of the run.
void CodeSet::take(AssetCodes codes, float held_out, uint64_t seed) {
  codes_ = std::move(codes);
  HostRandom random(seed, 0);
  std::vector<int32_t> order(codes_.count());
  std::iota(order.begin(), order.end(), 0);
  for (size_t i = order.size() - 1; i > 0; --i) std::swap(order[i], order[random.below(i + 1)]);
  const auto share = std::lround(held_out * static_cast<float>(order.size()));
  const size_t count = std::clamp<size_t>(static_cast<size_t>(share), 1, order.size() - 1);
  const auto end = order.begin() + static_cast<std::ptrdiff_t>(count);
  held_out_.assign(order.begin(), end);
  training_.assign(end, order.end());
  std::sort(held_out_.begin(), held_out_.end());
  std::sort(training_.begin(), training_.end());
  standardise();
}

/// Mean 0 and variance 1 a channel of what is drawn of the training codes, their own variance included.
void CodeSet::standardise() {
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
    deviation_[c] = std::max(kMinDeviation, static_cast<float>(std::sqrt(variance)));
  }
  const Shape shape = {static_cast<int64_t>(codes_.count()), codes_.channels, codes_.side, codes_.side};
  means_ = (from_host(codes_.means, shape) - by_channel(mean_)) / by_channel(deviation_);
  deviations_ = drawn ? from_host(codes_.deviations, shape) / by_channel(deviation_) : Tensor();
  eval(drawn ? Tensors{means_, deviations_} : Tensors{means_});
}

std::vector<std::string> CodeSet::describe() const {
  std::map<int32_t, int64_t> classes;
  for (const int32_t one : codes_.classes) classes[one]++;
  std::string kinds;
  for (const auto& [one, count] : classes) kinds += text(kinds.empty() ? "" : ", ", kAssetClasses[one], " ", count);
  const auto nights = std::count(codes_.nights.begin(), codes_.nights.end(), 1);
  return {text(codes_.count(), " codes of ", codes_.channels, "x", codes_.side, "x", codes_.side,
               deviations_ ? " with variance, " : " without variance, ", held_out_.size(), " held out"),
          text(kinds, "; ", nights, " at night")};
}

Tensor CodeSet::draw(const std::vector<int32_t>& rows, const RandomKey& key) const {
  const Tensor at = as_tensor(rows), mean = gather_rows(means_, at);
  return deviations_ ? mean + gather_rows(deviations_, at) * random_normal(mean.shape(), key) : mean;
}

CodeTable CodeSet::table(const std::vector<int32_t>& rows, const RandomKey& key) const {
  const Tensor at = as_tensor(rows);
  CodeTable table{as_rows(gather_rows(means_, at)), as_rows(draw(rows, key)), {}, {}, {}};
  if (deviations_) table.variances = as_rows(square(gather_rows(deviations_, at)));
  for (const int32_t row : rows) {
    table.classes.push_back(codes_.classes[static_cast<size_t>(row)]);
    table.nights.push_back(codes_.nights[static_cast<size_t>(row)]);
  }
  return table;
}

Condition CodeSet::condition_of(const std::vector<int32_t>& rows, const std::vector<bool>& dropped) const {
  std::vector<int32_t> classes, nights;
  for (size_t i = 0; i < rows.size(); ++i) {
    const auto row = static_cast<size_t>(rows[i]);
    const bool drop = !dropped.empty() && dropped[i];
    classes.push_back(drop ? kAssetClassCount : codes_.classes[row]);
    nights.push_back(drop ? kTimesOfDay : codes_.nights[row]);
  }
  return asset_condition(classes, nights);
}

Tensor CodeSet::floor_of(const std::vector<int32_t>& rows, const Level& level) const {
  if (!deviations_) return zeros({1});
  const Tensor variance = square(gather_rows(deviations_, as_tensor(rows)));
  return cloam::mean(variance / (variance * (level.alpha * level.alpha) + level.sigma * level.sigma));
}

int32_t CodeSet::drawn_actor(const AssetRequest& wish, uint64_t index) const {
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

Eigen::Vector3d CodeSet::nearest_size(const std::vector<float>& code, int asset_class) const {
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

/// As it is.
NewAsset CodeSet::actor_at(int32_t row) const {
  const auto at = static_cast<size_t>(row);
  const auto numbers = static_cast<std::ptrdiff_t>(codes_.means.size() / codes_.count());
  return {codes_.classes[at],
          codes_.nights[at] == 1,
          codes_.sizes[at],
          {codes_.means.begin() + row * numbers, codes_.means.begin() + (row + 1) * numbers}};
}

std::vector<NewAsset> CodeSet::training_assets(const AssetRequest& wish) const {
  std::vector<NewAsset> assets;
  int64_t fitting = 0;
  for (const int32_t row : training_) {
    const NewAsset asset = actor_at(row);
    if (asset.asset_class != wish.asset_class.value_or(asset.asset_class)) continue;
    if (asset.night != wish.night.value_or(asset.night)) continue;
    if (fitting++ < wish.first) continue;
    if (static_cast<int>(assets.size()) == wish.count) break;
    assets.push_back(asset);
  }
  if (fitting > 0) return assets;
  throw Error(Fault::usage, text("no such actor was in the training set; it had ", describe().back()));
}

std::vector<std::vector<float>> CodeSet::examples(int32_t asset_class, int32_t night) const {
  std::vector<std::vector<float>> alike, of_class, all;
  for (const int32_t row : training_) {
    const NewAsset asset = actor_at(row);
    all.push_back(asset.code);
    if (asset.asset_class == asset_class) of_class.push_back(asset.code);
    if (asset.asset_class == asset_class && asset.night == (night == 1)) alike.push_back(asset.code);
  }
  return !alike.empty() ? alike : !of_class.empty() ? of_class : all;
}

TensorMap CodeSet::state() const {
  const Shape shape = {static_cast<int64_t>(mean_.size())};
  return {{"mean", named(from_host(mean_, shape))}, {"deviation", named(from_host(deviation_, shape))}};
}

void CodeSet::restore(const TensorMap& state) {
  const Shape shape = {static_cast<int64_t>(mean_.size())};
  mean_ = tensor_from(state, "mean", shape).to_host();
  deviation_ = tensor_from(state, "deviation", shape).to_host();
}

}  // namespace cloam
