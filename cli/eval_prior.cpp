// See eval_prior.h.
#include "cli/eval_prior.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <map>

#include "cli/actors.h"
#include "cli/set_report.h"
#include "models/diffusion/code_figures.h"
#include "models/io/commit.h"
#include "models/scene/orbit.h"
#include "models/train/asset_prior.h"
#include "models/train/evaluate.h"
#include "models/train/restore_run.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kAllCodes = 1000000;
constexpr std::size_t kAssets = 320;  // of a set: four views of each are enough for the covariance of 512 features
constexpr int kLeastTraining = 20, kPairs = 8;
constexpr int kOfAClass[] = {48, 16};  // at most: training assets, which prototypes are made of, and samples
constexpr int kViews = 4, kPixels = 64;

using Json = nlohmann::ordered_json;

void check_options(const EvalRequest& request) {
  const std::pair<const char*, bool> options[] = {{"--data", !request.other.empty()},
                                                  {"--protocol", !request.protocol.empty()},
                                                  {"--images", !request.images.empty()}};
  for (const auto& [option, given] : options)
    if (given) throw Error(Fault::usage, text(option, " goes with photos, which ", request.run, " did not learn from"));
}

LabelledCodes labelled(const std::vector<NewAsset>& assets) {
  LabelledCodes codes;
  for (const NewAsset& asset : assets) codes.add(asset.code, asset.asset_class);
  return codes;
}

std::vector<NewAsset> assets_of(AssetPrior& prior, CodeSource source, int count) {
  AssetWish wish;
  wish.count = count;
  wish.codes = source;
  return prior.generate(wish);
}

/// Classes of which there are enough training codes to speak of.
std::vector<int> common_classes(const LabelledCodes& training) {
  std::map<int, int> counts;
  for (const int asset_class : training.classes) ++counts[asset_class];
  std::vector<int> classes;
  for (const auto& [asset_class, count] : counts)
    if (count >= kLeastTraining) classes.push_back(asset_class);
  return classes;
}

/// By the codes alone: samples are no copies.
void add_code_figures(AssetPrior& prior, Json& figures) {
  const LabelledCodes training = labelled(assets_of(prior, CodeSource::training, kAllCodes));
  figures["samples"] = kAssets;
  figures["copy_ratio"] = copy_ratio(labelled(assets_of(prior, CodeSource::sampled, kAssets)), training);
}

/// Features of views all around, a row each.
Eigen::MatrixXd features_of(Street& street, const std::vector<NewAsset>& assets, const FeatureNetwork& network) {
  Eigen::MatrixXd rows;
  const Camera camera = turntable_camera(kPixels, kPixels);
  Eigen::Index at = 0;
  for (const NewAsset& asset : assets) {
    const AssetName name = street.add_asset(asset);
    for (const Eigen::Matrix4d& pose : turntable_poses(asset.size, camera, kViews)) {
      const Eigen::MatrixXd row =
          pooled_features(network, as_batch(street.render_asset(name, camera, pose).rgb, kPixels, kPixels));
      if (at == 0) rows.resize(static_cast<Eigen::Index>(assets.size()) * kViews, row.cols());
      rows.row(at++) = row;
    }
  }
  return rows;
}

/// The mean grey of what an asset covers, all around.
double brightness(Street& street, const NewAsset& asset) {
  const Camera camera = turntable_camera(kPixels, kPixels);
  const AssetName name = street.add_asset(asset);
  double light = 0, covered = 1e-9;
  for (const Eigen::Matrix4d& pose : turntable_poses(asset.size, camera, kViews)) {
    const Picture picture = street.render_asset(name, camera, pose);
    for (std::size_t i = 0; i < picture.opacity.size(); ++i) {
      const double opacity = double{picture.opacity[i]};
      for (std::size_t c = 0; c < 3; ++c) light += (double{picture.rgb[3 * i + c]} - (1 - opacity)) / 3;
      covered += opacity;
    }
  }
  return light / covered;
}

/// Of pairs of one class and one seed, the share whose sample of the night is darker than that of the day.
double share_of_darker_nights(AssetPrior& prior, Street& street, const std::vector<int>& classes) {
  int darker = 0, pairs = 0;
  for (const int asset_class : classes) {
    std::vector<NewAsset> assets[2];
    for (const bool night : {false, true}) {
      AssetWish wish;
      wish.count = kPairs;
      wish.asset_class = asset_class;
      wish.night = night;
      assets[night] = prior.generate(wish);
    }
    for (std::size_t i = 0; i < assets[0].size(); ++i, ++pairs)
      darker += brightness(street, assets[1][i]) < brightness(street, assets[0][i]);
  }
  return static_cast<double>(darker) / pairs;
}

/// A row an asset: features of its pictures (the mean of all views), and the logarithms of its box's sides.
std::array<Eigen::MatrixXd, 2> looks_of(Street& street, const std::vector<NewAsset>& assets,
                                        const FeatureNetwork& network) {
  const Eigen::MatrixXd views = features_of(street, assets, network);
  const auto count = static_cast<Eigen::Index>(assets.size());
  std::array<Eigen::MatrixXd, 2> looks = {Eigen::MatrixXd(count, views.cols()), Eigen::MatrixXd(count, 3)};
  for (Eigen::Index i = 0; i < count; ++i) {
    looks[0].row(i) = views.middleRows(i * kViews, kViews).colwise().mean();
    looks[1].row(i) = assets[static_cast<std::size_t>(i)].size.array().log().transpose();
  }
  return looks;
}

/// Assets of each class, [0] of training and [1] samples that were asked for, by looks and boxes: each of both
/// counts with the same weight, and every number by its deviation over the training assets.
std::array<LabelledCodes, 2> looks_of_classes(AssetPrior& prior, Street& street, const FeatureNetwork& network,
                                              const std::vector<int>& classes) {
  std::array<LabelledCodes, 2> both;
  std::array<Eigen::RowVectorXd, 2> units;
  for (const bool sampled : {false, true}) {
    std::vector<NewAsset> assets;
    for (const int asset_class : classes) {
      AssetWish wish;
      wish.count = kOfAClass[sampled];
      wish.asset_class = asset_class;
      wish.codes = sampled ? CodeSource::sampled : CodeSource::training;
      for (const NewAsset& asset : prior.generate(wish)) assets.push_back(asset);
    }
    const auto looks = looks_of(street, assets, network);
    for (std::size_t k = 0; k < looks.size() && !sampled; ++k)  // of length 1 in all over the training assets
      units[k] = (looks[k].rowwise() - looks[k].colwise().mean()).colwise().norm().array() *
                     std::sqrt(static_cast<double>(looks[k].cols())) +
                 1e-9;
    for (Eigen::Index i = 0; i < looks[0].rows(); ++i) {
      std::vector<float> numbers;
      for (std::size_t k = 0; k < looks.size(); ++k)
        for (Eigen::Index c = 0; c < looks[k].cols(); ++c)
          numbers.push_back(static_cast<float>(looks[k](i, c) / units[k][c]));
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
void add_set_figures(AssetPrior& prior, Street& street, const FeatureNetwork& network, const std::vector<NewAsset>& all,
                     Json& figures) {
  const auto [training, others] = two_sets(all);
  const Eigen::MatrixXd truth = features_of(street, training, network);
  const auto add = [&](const std::string& prefix, const std::vector<NewAsset>& assets) {
    Json distances;
    add_sets(distances, network.name, set_distances(features_of(street, assets, network), truth));
    for (const auto& [key, value] : distances.items())
      if (prefix.empty() || key != "set_images") figures[prefix + key] = value;
  };
  add("", assets_like(prior, CodeSource::sampled, training));
  add("baseline_random_", assets_like(prior, CodeSource::random, training));
  if (others.size() > 1) add("baseline_training_", others);
}

/// Of samples as they look: as a set like the training assets; of their class; dark at night.
void add_picture_figures(AssetPrior& prior, const RestoredRun& decoder, const FeatureNetwork& network, Json& figures) {
  Street& street = street_of(decoder);
  const std::vector<NewAsset> all = assets_of(prior, CodeSource::training, kAllCodes);
  add_set_figures(prior, street, network, all, figures);
  figures["feature_network"] = network.name;
  const std::vector<int> classes = common_classes(labelled(all));
  if (classes.size() > 1) {
    const auto looks = looks_of_classes(prior, street, network, classes);
    figures["class_right"] = share_of_right_classes(looks[1], looks[0]);
    figures["class_right_of_training"] = share_of_right_classes(looks[0], looks[0]);
    figures["baseline_class_right"] = 1.0 / static_cast<double>(classes.size());
  }
  const bool both = std::any_of(all.begin(), all.end(), [](const NewAsset& asset) { return asset.night; }) &&
                    std::any_of(all.begin(), all.end(), [](const NewAsset& asset) { return !asset.night; });
  if (both) figures["night_darker"] = share_of_darker_nights(prior, street, classes);
}

}  // namespace

nlohmann::ordered_json measure_prior(const EvalRequest& request, const Common& common) {
  check_options(request);
  const auto start = std::chrono::steady_clock::now();
  open_device(common);
  const RestoredRun run = restore_run(request.run);
  if (!run.checkpoint.warning.empty()) warn(run.checkpoint.warning);
  AssetPrior& prior = *run.method->prior();
  StoredRun source = read_source(run);
  prior.load(source);
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
  if (!request.features.empty()) {
    const FeatureNetwork network = features_named(request.features);
    add_picture_figures(prior, restore_run(std::move(source)), network, figures);
  }
  figures["method"] = run.record.method;
  figures["preset"] = run.record.preset;
  figures["step"] = run.progress.step;
  figures["seconds"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  commit_text(RunPaths{request.run}.eval() / "eval.json", figures.dump(2) + "\n");
  return figures;
}

std::string prior_table(const nlohmann::ordered_json& f) {
  const auto row = [&](const char* what, const char* key) {
    return f.contains(key) ? fmt::format("{:<38}{:.4f}\n", what, f.at(key).get<double>()) : "";
  };
  return fmt::format("{} codes held out, {} trained on, step {}\n", f.at("codes").get<int64_t>(),
                     f.at("training_codes").get<int64_t>(), f.at("step").get<int64_t>()) +
         row("v-loss", "v_loss") + row("of predicting zero", "baseline_zero_v_loss") +
         row("of knowing their means", "floor_v_loss") + row("on the training codes", "training_v_loss") +
         row("distance to training over its own", "copy_ratio") +
         row("samples taken for the class asked for", "class_right") +
         row("training assets for their class", "class_right_of_training") + row("by chance", "baseline_class_right") +
         row("Frechet distance to training", "frechet_feature_distance") + row("FID to training", "fid") +
         row("of random codes", "baseline_random_frechet_feature_distance") +
         row("of random codes", "baseline_random_fid") +
         row("of other training assets", "baseline_training_frechet_feature_distance") +
         row("of other training assets", "baseline_training_fid") +
         row("kernel distance to training", "kernel_feature_distance") + row("KID to training", "kid") +
         row("of random codes", "baseline_random_kernel_feature_distance") +
         row("of random codes", "baseline_random_kid") + row("nights darker than days", "night_darker");
}

}  // namespace cloam
