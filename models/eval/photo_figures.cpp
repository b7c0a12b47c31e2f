// See photo_figures.h.
#include "models/eval/photo_figures.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <span>

#include "models/eval/image_sets.h"
#include "models/io/crc32c.h"
#include "models/io/host_random.h"
#include "models/metrics/class_regression.h"
#include "models/scene/asset_class.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Report = nlohmann::ordered_json;
using Eigen::Index;
using Eigen::MatrixXd;

constexpr uint64_t kSeed = 0;  // of what is chosen: the same for all runs
constexpr std::size_t kMostCrops = 2000, kMostMatched = 1000, kMostAssets = 320;
constexpr int kLeastCrops = 8, kLeastHeldOut = 2, kLeastCodes = 5;  // of a class that is told from others
constexpr int kTrainingOfAClass = 48, kSamplesOfAClass = 16;

using Kind = std::pair<int, bool>;  // class and night

/// So many of all, each as likely as any other, in their order.
std::vector<std::size_t> drawn(std::size_t all, std::size_t most) {
  std::vector<std::size_t> places(all);
  std::iota(places.begin(), places.end(), std::size_t{0});
  HostRandom random(kSeed);
  for (std::size_t i = places.size(); i > 1; --i) std::swap(places[i - 1], places[random.below(i)]);
  places.resize(std::min(all, most));
  std::sort(places.begin(), places.end());
  return places;
}

MatrixXd log_sides(const std::vector<Eigen::Vector3d>& sizes) {
  MatrixXd rows(static_cast<Index>(sizes.size()), 3);
  for (std::size_t i = 0; i < sizes.size(); ++i) rows.row(static_cast<Index>(i)) = sizes[i].array().log().transpose();
  return rows;
}

std::vector<Eigen::Vector3d> sizes_of(const std::vector<NewAsset>& assets) {
  std::vector<Eigen::Vector3d> sizes;
  for (const NewAsset& asset : assets) sizes.push_back(asset.size);
  return sizes;
}

/// Tells classes apart as rows of photos do.
struct Judge {
  explicit Judge(const LabelledRows& photos) : strength(likeliest_strength(photos)), by(photos, strength) {}
  MatrixXd log_p(const MatrixXd& rows) const { return by.log_probabilities(rows); }
  Accuracy right(const MatrixXd& log_probabilities, const std::vector<int>& classes) const {
    return accuracy(log_probabilities, by.classes(), classes);
  }
  double strength;
  ClassRegression by;
};

/// Rows of several views an asset: the mean of their log-probabilities.
MatrixXd by_asset(const MatrixXd& views) {
  MatrixXd rows(views.rows() / Showroom::kViews, views.cols());
  for (Index i = 0; i < rows.rows(); ++i)
    rows.row(i) = views.middleRows(i * Showroom::kViews, Showroom::kViews).colwise().mean();
  return rows;
}

std::vector<int> classes_of(const std::vector<NewAsset>& assets) {
  std::vector<int> classes;
  for (const NewAsset& asset : assets) classes.push_back(asset.asset_class);
  return classes;
}

/// {"Car": {"Car": 0.9, "Truck": 0.1}, ...}: what the classes are taken for.
Report in_words(const Accuracy& accuracy) {
  Report out = Report::object();
  for (const auto& [truth, shares] : accuracy.named)
    for (const auto& [named, share] : shares) out[kAssetClasses[truth]][kAssetClasses[named]] = share;
  return out;
}

/// Boxes stand upright: z is up.
double median_height(const std::vector<PhotoCrop>& photos) {
  std::vector<double> heights;
  for (const PhotoCrop& photo : photos) {
    const Eigen::Vector3d camera = photo.box_from_camera.topRightCorner<3, 1>();
    heights.push_back(std::asin(camera.z() / camera.norm()));
  }
  const auto middle = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
  std::nth_element(heights.begin(), middle, heights.end());
  return *middle;
}

/// How much further from photos samples are than renders of training codes, over that of the Gaussians' samples.
Report ratio_of(double samples, double gaussians, double training) {
  const double ratio = (samples - training) / (gaussians - training);
  return gaussians > training && std::isfinite(ratio) ? Report(ratio) : Report(nullptr);
}

}  // namespace

PhotoFigures::PhotoFigures(GeneratesAssets& prior, const PhotoCrops& photos, const Listener& listener)
    : prior_(prior), pixels_(photos.size), height_(median_height(photos.crops)) {
  const std::vector<bool> held_out = held_out_crops(photos, kSeed);
  for (const std::size_t place : drawn(photos.crops.size(), kMostCrops)) {
    photos_.push_back(photos.crops[place]);
    held_out_.push_back(held_out[place]);
  }
  const std::vector<NewAsset> training = prior.generate({.count = kAllCodes, .codes = CodeSource::training});
  match(training);
  choose_classes(training);
  if (matched_.size() < 2)
    bad_data("of ", photos_.size(), " photos ", matched_.size(), " show a class and time of day that the run was ",
             "trained on, want two or more");
  if (classes_.size() < 2)
    listener.warn(text("no figures of classes: ", classes_.size(), " have ", kLeastCrops, " photos to learn from, ",
                       kLeastHeldOut, " of other logs and ", kLeastCodes, " training codes; want two classes"));
}

/// Of each class and time of day so many assets that there are kMostAssets in all, if there are training codes.
void PhotoFigures::match(const std::vector<NewAsset>& training) {
  std::map<Kind, std::vector<std::size_t>> assets, photos;
  for (std::size_t i = 0; i < training.size(); ++i) assets[{training[i].asset_class, training[i].night}].push_back(i);
  std::vector<std::size_t> known;
  for (std::size_t i = 0; i < photos_.size(); ++i)
    if (assets.contains({photos_[i].asset_class, photos_[i].night})) known.push_back(i);
  for (const std::size_t place : drawn(known.size(), kMostMatched)) matched_.push_back(known[place]);
  for (std::size_t i = 0; i < matched_.size(); ++i)
    photos[{photos_[matched_[i]].asset_class, photos_[matched_[i]].night}].push_back(i);
  shown_.resize(matched_.size());
  for (const auto& [kind, places] : photos) {
    const std::vector<std::size_t>& of_kind = assets[kind];
    const std::size_t share = (places.size() * kMostAssets + matched_.size() - 1) / matched_.size();
    const std::size_t count = std::min({places.size(), share, of_kind.size()}), first = training_.size();
    for (std::size_t i = 0; i < count; ++i) training_.push_back(training[of_kind[i * of_kind.size() / count]]);
    for (std::size_t i = 0; i < places.size(); ++i) shown_[places[i]] = first + i % count;
  }
}

void PhotoFigures::choose_classes(const std::vector<NewAsset>& training) {
  std::map<int, int> codes, crops[2];
  for (const NewAsset& asset : training) ++codes[asset.asset_class];
  for (std::size_t i = 0; i < photos_.size(); ++i) ++crops[held_out_[i]][photos_[i].asset_class];
  for (const auto& [asset_class, count] : codes)
    if (count >= kLeastCodes && crops[0][asset_class] >= kLeastCrops && crops[1][asset_class] >= kLeastHeldOut)
      classes_[asset_class] = std::min(count, kTrainingOfAClass);
}

std::size_t PhotoFigures::expected() const {
  std::size_t count = 4 * training_.size();
  if (classes_.size() < 2) return count;
  for (const auto& [asset_class, training] : classes_) count += static_cast<std::size_t>(training + kSamplesOfAClass);
  return count;
}

std::vector<std::string> PhotoFigures::files() const {
  std::vector<std::string> names;
  for (const std::size_t place : matched_) names.push_back(photos_[place].file.filename().string());
  return names;
}

void PhotoFigures::add(Showroom& showroom, const Listener& listener, Report& figures) const {
  std::vector<fs::path> paths;
  for (const PhotoCrop& photo : photos_) paths.push_back(photo.file);
  const MatrixXd features = features_of(paths, showroom.network(), listener);
  add_distances(showroom, features, figures);
  if (classes_.size() > 1) add_classes(showroom, features, figures);
}

void PhotoFigures::add_distances(Showroom& showroom, const MatrixXd& features, Report& figures) const {
  const MatrixXd truth = features(std::vector<Index>(matched_.begin(), matched_.end()), Eigen::all);
  std::vector<PhotoCrop> photos;
  for (const std::size_t place : matched_) photos.push_back(photos_[place]);
  std::string names;
  for (const std::string& name : files()) names += name + "\n";
  figures["photos"] = photos.size();
  figures["photos_list"] = crc32c_digits(crc32c(std::as_bytes(std::span(names))));
  figures["photos_assets"] = training_.size();
  const auto distances_of = [&](const std::string& prefix, const std::vector<NewAsset>& assets) {
    const SetDistances distances = set_distances(showroom.features_as_photographed(assets, shown_, photos), truth);
    Report keys;
    add_sets(keys, showroom.network().name, distances);
    for (const auto& [key, value] : keys.items())
      if (key != "set_images") figures["photos_" + prefix + key] = value;
    return distances;
  };
  const SetDistances samples = distances_of("", assets_like(prior_, CodeSource::sampled, training_));
  const SetDistances gaussians =
      distances_of("baseline_gaussian_", assets_like(prior_, CodeSource::gaussian, training_));
  distances_of("baseline_random_", assets_like(prior_, CodeSource::random, training_));
  const SetDistances training = distances_of("baseline_training_", training_);
  figures["photos_frechet_ratio"] = ratio_of(samples.frechet, gaussians.frechet, training.frechet);
  figures["photos_kernel_ratio"] = ratio_of(samples.kernel.mean, gaussians.kernel.mean, training.kernel.mean);
}

PhotoFigures::ClassPhotos PhotoFigures::class_photos(const MatrixXd& features, bool held_out) const {
  ClassPhotos photos;
  std::map<std::string, int> numbers;
  std::vector<Index> places;
  std::vector<Eigen::Vector3d> sizes;
  for (std::size_t i = 0; i < photos_.size(); ++i) {
    const PhotoCrop& photo = photos_[i];
    if (held_out_[i] != held_out || !classes_.contains(photo.asset_class)) continue;
    places.push_back(static_cast<Index>(i));
    sizes.push_back(photo.size);
    photos.logs.insert(photo.log);
    photos.pictures.classes.push_back(photo.asset_class);
    photos.pictures.groups.push_back(numbers.emplace(photo.log, static_cast<int>(numbers.size())).first->second);
  }
  photos.boxes = photos.pictures;
  photos.pictures.rows = features(places, Eigen::all);
  photos.boxes.rows = log_sides(sizes);
  return photos;
}

void PhotoFigures::add_classes(Showroom& showroom, const MatrixXd& features, Report& figures) const {
  const ClassPhotos training = class_photos(features, false), held_out = class_photos(features, true);
  const Judge by_pictures(training.pictures), by_box(training.boxes);
  figures["classes"] = Report::array();
  for (const auto& [asset_class, count] : classes_) figures["classes"].push_back(kAssetClasses[asset_class]);
  figures["class_crops"] = {training.pictures.classes.size(), held_out.pictures.classes.size()};
  figures["class_logs_held_out"] = held_out.logs;
  figures["class_strength"] = by_pictures.strength;
  figures["class_strength_box"] = by_box.strength;
  const Accuracy of_photos = by_pictures.right(by_pictures.log_p(held_out.pictures.rows), held_out.pictures.classes);
  figures["class_right_photos_held_out"] = of_photos.balanced;
  figures["class_right_photos_held_out_plain"] = of_photos.plain;
  figures["class_named_photos_held_out"] = in_words(of_photos);
  figures["class_right_box_photos_held_out"] =
      by_box.right(by_box.log_p(held_out.boxes.rows), held_out.boxes.classes).balanced;
  for (const CodeSource source : {CodeSource::sampled, CodeSource::training}) {
    const std::vector<NewAsset> assets = assets_of_classes(source);
    const std::string suffix = source == CodeSource::sampled ? "" : "_of_training";
    const MatrixXd views = by_pictures.log_p(showroom.features_as_crops(assets, pixels_, height_));
    const Accuracy of_pictures = by_pictures.right(by_asset(views), classes_of(assets));
    figures["class_right_pictures" + suffix] = of_pictures.balanced;
    figures["class_named_pictures" + suffix] = in_words(of_pictures);
    figures["class_right_box" + suffix] =
        by_box.right(by_box.log_p(log_sides(sizes_of(assets))), classes_of(assets)).balanced;
  }
  figures["baseline_class_right"] = 1.0 / static_cast<double>(classes_.size());
}

std::vector<NewAsset> PhotoFigures::assets_of_classes(CodeSource source) const {
  std::vector<NewAsset> assets;
  for (const auto& [asset_class, training] : classes_) {
    const int count = source == CodeSource::training ? training : kSamplesOfAClass;
    for (NewAsset& asset : prior_.generate({.count = count, .asset_class = asset_class, .codes = source}))
      assets.push_back(std::move(asset));
  }
  return assets;
}

}  // namespace cloam
