// See prior_figures.h.
#include "models/eval/prior_figures.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "models/diffusion/code_figures.h"
#include "models/eval/evaluate.h"
#include "models/eval/image_sets.h"
#include "models/io/commit.h"
#include "models/io/words.h"
#include "models/latents/generates_assets.h"
#include "models/latents/shows_assets.h"
#include "models/scene/orbit.h"
#include "models/street/street.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kAllCodes = 1000000;
constexpr std::size_t kAssets = 320;  // of a set: four views of each are enough for the covariance of 512 features
constexpr int kMinTraining = 20, kPairs = 8;
constexpr int kOfAClass[] = {48, 16};  // at most: training assets, which prototypes are made of, and samples
constexpr int kViews = 4, kPixels = 64;
constexpr std::size_t kTold = 64;  // assets from one line of progress to the next

using Json = nlohmann::ordered_json;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

LabelledCodes labelled(const std::vector<NewAsset>& assets) {
  LabelledCodes codes;
  for (const NewAsset& asset : assets) codes.add(asset.code, asset.asset_class);
  return codes;
}

std::vector<NewAsset> assets_of(GeneratesAssets& prior, CodeSource source, int count) {
  return prior.generate({.count = count, .codes = source});
}

/// Classes of which there are enough training codes to speak of.
std::vector<int> common_classes(const LabelledCodes& training) {
  std::map<int, int> counts;
  for (const int asset_class : training.classes) ++counts[asset_class];
  std::vector<int> classes;
  for (const auto& [asset_class, count] : counts)
    if (count >= kMinTraining) classes.push_back(asset_class);
  return classes;
}

/// By the codes alone: samples are no copies.
void add_code_figures(GeneratesAssets& prior, Json& figures) {
  const LabelledCodes training = labelled(assets_of(prior, CodeSource::training, kAllCodes));
  figures["samples"] = kAssets;
  figures["copy_ratio"] = copy_ratio(labelled(assets_of(prior, CodeSource::sampled, kAssets)), training);
}

/// Where assets are looked at from all sides, with the time that is left for those still to come.
class Showroom {
 public:
  Showroom(Method& decoder, const FeatureNetwork& network, std::size_t expected, const Listener& listener)
      : street_(*as<Street>(decoder)),
        shows_(*as<ShowsAssets>(decoder)),
        network_(network),
        expected_(expected),
        listener_(listener) {}

  /// A row a view.
  Eigen::MatrixXd features_of(const std::vector<NewAsset>& assets) {
    Eigen::MatrixXd rows;
    Eigen::Index at = 0;
    for (const NewAsset& asset : assets)
      for (const Picture& picture : views_of(asset)) {
        const Eigen::MatrixXd row = pooled_features(network_, as_batch(picture.rgb, kPixels, kPixels));
        if (at == 0) rows.resize(static_cast<Eigen::Index>(assets.size()) * kViews, row.cols());
        rows.row(at++) = row;
      }
    return rows;
  }

  /// The mean grey of what an asset covers.
  double brightness(const NewAsset& asset) {
    double light = 0, covered = 1e-9;
    for (const Picture& picture : views_of(asset))
      for (std::size_t i = 0; i < picture.opacity.size(); ++i) {
        const double opacity = double{picture.opacity[i]};
        for (std::size_t c = 0; c < 3; ++c) light += (double{picture.rgb[3 * i + c]} - (1 - opacity)) / 3;
        covered += opacity;
      }
    return light / covered;
  }

  const std::string& network() const { return network_.name; }

 private:
  std::vector<Picture> views_of(const NewAsset& asset) {
    listener_.check_stop(
        [&] { return text(shown_, " of ", expected_, " assets were measured; no metrics were written"); });
    const Camera camera = turntable_camera(kPixels, kPixels);
    const AssetName name = shows_.show_assets({asset}).front();
    std::vector<Picture> views;
    for (const Eigen::Matrix4d& pose : turntable_poses(asset.size, camera, kViews))
      views.push_back(street_.render_asset(name, camera, pose));
    if (++shown_ % kTold == 0 || shown_ == expected_) tell();
    return views;
  }

  void tell() const {
    const double seconds = seconds_since(start_);
    const double left = seconds / static_cast<double>(shown_) * static_cast<double>(expected_ - shown_);
    listener_.say(text("eval ", shown_, "/", expected_, " assets  left ", words_for_seconds(left)));
  }

  Street& street_;
  ShowsAssets& shows_;
  const FeatureNetwork& network_;
  std::size_t shown_ = 0, expected_;
  const Listener& listener_;
  const Clock::time_point start_ = Clock::now();
};

/// Of pairs of one class and one seed, the share whose sample of the night is darker than that of the day.
double share_of_darker_nights(GeneratesAssets& prior, Showroom& showroom, const std::vector<int>& classes) {
  int darker = 0, pairs = 0;
  for (const int asset_class : classes) {
    std::vector<NewAsset> assets[2];
    for (const bool night : {false, true})
      assets[night] = prior.generate({.count = kPairs, .asset_class = asset_class, .night = night});
    for (std::size_t i = 0; i < assets[0].size(); ++i, ++pairs)
      darker += showroom.brightness(assets[1][i]) < showroom.brightness(assets[0][i]);
  }
  return static_cast<double>(darker) / pairs;
}

/// A row an asset: features of its pictures (the mean of all views), and the logarithms of its box's sides.
std::array<Eigen::MatrixXd, 2> appearance_of(Showroom& showroom, const std::vector<NewAsset>& assets) {
  const Eigen::MatrixXd views = showroom.features_of(assets);
  const auto count = static_cast<Eigen::Index>(assets.size());
  std::array<Eigen::MatrixXd, 2> appearance = {Eigen::MatrixXd(count, views.cols()), Eigen::MatrixXd(count, 3)};
  for (Eigen::Index i = 0; i < count; ++i) {
    appearance[0].row(i) = views.middleRows(i * kViews, kViews).colwise().mean();
    appearance[1].row(i) = assets[static_cast<std::size_t>(i)].size.array().log().transpose();
  }
  return appearance;
}

/// Assets of each class, [0] of training and [1] samples that were asked for, by looks and boxes: each of both
/// counts with the same weight, and every number by its deviation over the training assets.
std::array<LabelledCodes, 2> looks_of_classes(GeneratesAssets& prior, Showroom& showroom,
                                              const std::vector<int>& classes) {
  std::array<LabelledCodes, 2> both;
  std::array<Eigen::RowVectorXd, 2> units;
  for (const bool sampled : {false, true}) {
    std::vector<NewAsset> assets;
    const CodeSource source = sampled ? CodeSource::sampled : CodeSource::training;
    for (const int asset_class : classes)
      for (const NewAsset& asset :
           prior.generate({.count = kOfAClass[sampled], .asset_class = asset_class, .codes = source}))
        assets.push_back(asset);
    const auto appearance = appearance_of(showroom, assets);
    for (std::size_t k = 0; k < appearance.size() && !sampled; ++k)  // of length 1 in all over the training assets
      units[k] = (appearance[k].rowwise() - appearance[k].colwise().mean()).colwise().norm().array() *
                     std::sqrt(static_cast<double>(appearance[k].cols())) +
                 1e-9;
    for (Eigen::Index i = 0; i < appearance[0].rows(); ++i) {
      std::vector<float> numbers;
      for (std::size_t k = 0; k < appearance.size(); ++k)
        for (Eigen::Index c = 0; c < appearance[k].cols(); ++c)
          numbers.push_back(static_cast<float>(appearance[k](i, c) / units[k][c]));
      both[sampled].add(numbers, assets[static_cast<std::size_t>(i)].asset_class);
    }
  }
  return both;
}

/// Two sets that have no asset in common, of at most kAssets each, from the first log to the last.
std::array<std::vector<NewAsset>, 2> two_sets(const std::vector<NewAsset>& all) {
  std::array<std::vector<NewAsset>, 2> sets;
  const std::size_t count = std::min(all.size(), 2 * kAssets);
  for (std::size_t i = 0; i < count; ++i) sets[i % 2].push_back(all[i * all.size() / count]);
  return sets;
}

/// How far samples are, as they look, from training assets of the same classes and times of day; random codes, which
/// know nothing, and other training assets in between, which are all that samples can be.
void add_set_figures(GeneratesAssets& prior, Showroom& showroom, const std::array<std::vector<NewAsset>, 2>& training,
                     Json& figures) {
  const Eigen::MatrixXd truth = showroom.features_of(training[0]);
  const auto add = [&](const std::string& prefix, const std::vector<NewAsset>& assets) {
    Json distances;
    add_sets(distances, showroom.network(), set_distances(showroom.features_of(assets), truth));
    for (const auto& [key, value] : distances.items())
      if (prefix.empty() || key != "set_images") figures[prefix + key] = value;
  };
  add("", assets_like(prior, CodeSource::sampled, training[0]));
  add("baseline_random_", assets_like(prior, CodeSource::random, training[0]));
  if (training[1].size() > 1) add("baseline_training_", training[1]);
}

bool has_night_and_day(const std::vector<NewAsset>& assets) {
  const auto nights = std::count_if(assets.begin(), assets.end(), [](const NewAsset& asset) { return asset.night; });
  return nights > 0 && nights < static_cast<std::ptrdiff_t>(assets.size());
}

/// How many assets add_picture_figures looks at.
std::size_t count_of_shown(const LabelledCodes& training, const std::array<std::vector<NewAsset>, 2>& sets,
                           const std::vector<int>& classes, bool nights) {
  std::size_t count = 3 * sets[0].size() + (sets[1].size() > 1 ? sets[1].size() : 0);
  if (nights) count += 2 * kPairs * classes.size();
  for (const int asset_class : classes) {
    const auto all = static_cast<int>(std::count(training.classes.begin(), training.classes.end(), asset_class));
    if (classes.size() > 1) count += static_cast<std::size_t>(std::min(all, kOfAClass[0]) + kOfAClass[1]);
  }
  return count;
}

/// Of samples as they look: as a set like the training assets; of their class; dark at night.
void add_picture_figures(GeneratesAssets& prior, const RestoredRun& decoder, const FeatureNetwork& network,
                         const Listener& listener, Json& figures) {
  const std::vector<NewAsset> all = assets_of(prior, CodeSource::training, kAllCodes);
  const auto sets = two_sets(all);
  const LabelledCodes training = labelled(all);
  const std::vector<int> classes = common_classes(training);
  const bool nights = !classes.empty() && has_night_and_day(all);
  Showroom showroom(*decoder.method, network, count_of_shown(training, sets, classes, nights), listener);
  add_set_figures(prior, showroom, sets, figures);
  figures["feature_network"] = network.name;
  if (classes.size() > 1) {
    const auto appearance = looks_of_classes(prior, showroom, classes);
    figures["class_right"] = share_of_right_classes(appearance[1], appearance[0]);
    figures["class_right_of_training"] = share_of_right_classes(appearance[0], appearance[0]);
    figures["baseline_class_right"] = 1.0 / static_cast<double>(classes.size());
  }
  if (nights) figures["night_darker"] = share_of_darker_nights(prior, showroom, classes);
}

}  // namespace

nlohmann::ordered_json measure_prior(const RestoredRun& run, const FeatureNetwork* network, const Listener& listener) {
  const Clock::time_point start = Clock::now();
  auto& prior = *as<GeneratesAssets>(*run.method);
  StoredRun source = read_source(run);
  as<LearnsFromRun>(*run.method)->load(source_of(source));
  const PriorScore score = prior.score();
  Json figures = {{"schema_version", 1},
                  {"protocol", "held-out-codes"},
                  {"codes", score.codes},
                  {"training_codes", score.training_codes},
                  {"v_loss", score.v_loss},
                  {"baseline_zero_v_loss", score.zero_v_loss},
                  {"floor_v_loss", score.floor_v_loss},
                  {"training_v_loss", score.training_v_loss}};
  add_code_figures(prior, figures);
  if (network) add_picture_figures(prior, restore_run(std::move(source)), *network, listener, figures);
  figures["method"] = run.record.method;
  figures["preset"] = run.record.preset;
  figures["step"] = run.progress.step;
  figures["seconds"] = seconds_since(start);
  commit_text(RunPaths{run.folder}.eval() / "eval.json", figures.dump(2) + "\n");
  return figures;
}

}  // namespace cloam
