// See prior_figures.h.
#include "models/eval/prior_figures.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "models/diffusion/code_figures.h"
#include "models/eval/evaluate.h"
#include "models/eval/image_sets.h"
#include "models/eval/photo_figures.h"
#include "models/eval/showroom.h"
#include "models/io/commit.h"
#include "models/latents/generates_assets.h"

namespace cloam {
namespace {

constexpr std::size_t kAssets = 320;  // of a set: four views of each are enough for the covariance of 512 features
constexpr int kMinTraining = 20, kPairs = 8;

using Report = nlohmann::ordered_json;
using Clock = std::chrono::steady_clock;

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
void add_code_figures(GeneratesAssets& prior, Report& figures) {
  const LabelledCodes training = labelled(assets_of(prior, CodeSource::training, kAllCodes));
  figures["samples"] = kAssets;
  figures["copy_ratio"] = copy_ratio(labelled(assets_of(prior, CodeSource::sampled, kAssets)), training);
}

/// Of pairs of one class and one seed, the share whose sample of the night is darker than that of the day.
double share_of_darker_nights(GeneratesAssets& prior, Showroom& showroom, const std::vector<int>& classes) {
  int darker = 0, pairs = 0;
  for (const int asset_class : classes) {
    std::vector<NewAsset> assets[2];
    for (const bool night : {false, true})
      assets[night] = prior.generate({.count = kPairs, .asset_class = asset_class, .night = night});
    const std::vector<double> by_day = showroom.brightness(assets[0]), by_night = showroom.brightness(assets[1]);
    for (std::size_t i = 0; i < by_day.size(); ++i, ++pairs) darker += by_night[i] < by_day[i];
  }
  return static_cast<double>(darker) / pairs;
}

/// Two sets that have no asset in common, of at most kAssets each, from the first log to the last.
std::array<std::vector<NewAsset>, 2> two_sets(const std::vector<NewAsset>& all) {
  std::array<std::vector<NewAsset>, 2> sets;
  const std::size_t count = std::min(all.size(), 2 * kAssets);
  for (std::size_t i = 0; i < count; ++i) sets[i % 2].push_back(all[i * all.size() / count]);
  return sets;
}

/// How far samples are, as they look, from training assets of the same classes and times of day, by renders of one
/// decoder; Gaussians' samples, white noise, which knows nothing, and other training assets, which are all that samples
/// can be.
void add_set_figures(GeneratesAssets& prior, Showroom& showroom, const std::array<std::vector<NewAsset>, 2>& training,
                     Report& figures) {
  const Eigen::MatrixXd truth = showroom.features_of(training[0]);
  const auto add = [&](const std::string& prefix, const std::vector<NewAsset>& assets) {
    Report distances;
    add_sets(distances, showroom.network().name, set_distances(showroom.features_of(assets), truth));
    for (const auto& [key, value] : distances.items())
      if (prefix.empty() || key != "set_images") figures[prefix + key] = value;
  };
  add("", assets_like(prior, CodeSource::sampled, training[0]));
  add("baseline_gaussian_", assets_like(prior, CodeSource::gaussian, training[0]));
  add("baseline_random_", assets_like(prior, CodeSource::random, training[0]));
  if (training[1].size() > 1) add("baseline_training_", training[1]);
}

bool has_night_and_day(const std::vector<NewAsset>& assets) {
  const auto nights = std::count_if(assets.begin(), assets.end(), [](const NewAsset& asset) { return asset.night; });
  return nights > 0 && nights < static_cast<std::ptrdiff_t>(assets.size());
}

/// Of samples as they look: as a set like the training assets; like photographs; dark at night.
void add_picture_figures(GeneratesAssets& prior, const RestoredRun& decoder, const PriorReferences& by,
                         const Listener& listener, const Ranks& ranks, Report& figures) {
  const std::vector<NewAsset> all = assets_of(prior, CodeSource::training, kAllCodes);
  const auto sets = two_sets(all);
  const std::vector<int> classes = common_classes(labelled(all));
  const bool nights = !classes.empty() && has_night_and_day(all);
  std::optional<PhotoFigures> by_photos;
  if (by.photos) by_photos.emplace(prior, *by.photos, listener);
  std::size_t expected = 4 * sets[0].size() + (sets[1].size() > 1 ? sets[1].size() : 0);
  if (nights) expected += 2 * kPairs * classes.size();
  if (by_photos) expected += by_photos->expected();
  Showroom showroom(*decoder.method, *by.network, expected, listener, ranks);
  add_set_figures(prior, showroom, sets, figures);
  figures["feature_network"] = by.network->name;
  if (by_photos) by_photos->add(showroom, listener, figures);
  if (nights) figures["night_darker"] = share_of_darker_nights(prior, showroom, classes);
  if (by_photos) figures["photos_files"] = by_photos->files();
}

}  // namespace

nlohmann::ordered_json measure_prior(const RestoredRun& run, const PriorReferences& by, const Listener& listener,
                                     const Ranks& ranks) {
  const Clock::time_point start = Clock::now();
  auto& prior = *as<GeneratesAssets>(*run.method);
  StoredRun source = load_source(run);
  const PriorScore score = prior.score();
  Report figures = {{"schema_version", 2},
                    {"protocol", "held-out-codes"},
                    {"codes", score.codes},
                    {"training_codes", score.training_codes},
                    {"v_loss", score.v_loss},
                    {"baseline_zero_v_loss", score.zero_v_loss},
                    {"wiener_v_loss", score.wiener_v_loss},
                    {"floor_v_loss", score.floor_v_loss},
                    {"training_v_loss", score.training_v_loss}};
  figures["gaussian_weights"] = {
      {"own", score.shrinkage.own}, {"pooled", score.shrinkage.pooled}, {"diagonal", score.shrinkage.diagonal}};
  add_code_figures(prior, figures);
  if (by.network) add_picture_figures(prior, restore_run(std::move(source)), by, listener, ranks, figures);
  figures["method"] = run.record.method;
  figures["preset"] = run.record.preset;
  figures["step"] = run.progress.step;
  figures["seconds"] = std::chrono::duration<double>(Clock::now() - start).count();
  if (ranks.rank() == 0) commit_text(RunPaths{run.folder}.eval() / "eval.json", figures.dump(2) + "\n");
  figures.erase("photos_files");  // for the file alone: there may be a thousand
  return figures;
}

}  // namespace cloam
