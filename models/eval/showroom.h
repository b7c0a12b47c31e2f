// Where assets are looked at, from all sides or as photographs look at theirs, with the time that is left for those
// still to come.
#pragma once
#include <Eigen/Core>
#include <chrono>
#include <functional>
#include <string>
#include <vector>

#include "models/eval/photo_crops.h"
#include "models/latents/shows_assets.h"
#include "models/nn/feature_network.h"
#include "models/runs/listener.h"
#include "models/street/street.h"
#include "models/train/method.h"
#include "models/train/ranks.h"

namespace cloam {

class Showroom {
 public:
  static constexpr int kViews = 4;  // around an asset

  /// expected: how many assets will be shown. Ranks share those of each call, and all get what it returns.
  Showroom(Method& decoder, const FeatureNetwork& network, std::size_t expected, const Listener& listener,
           const Ranks& ranks);
  /// Features of the views around each asset, kViews rows an asset.
  Eigen::MatrixXd features_of(const std::vector<NewAsset>& assets);
  /// The same, framed and cut out as crops of photographs are, of their size and from as far above the horizon
  /// (radians).
  Eigen::MatrixXd features_as_crops(const std::vector<NewAsset>& assets, int pixels, double height);
  /// A row a photo: features of the asset that stands for it, seen by its camera and cut out. assets[shown[i]] is for
  /// photos[i]; each asset that is named counts as shown once.
  Eigen::MatrixXd features_as_photographed(const std::vector<NewAsset>& assets, const std::vector<std::size_t>& shown,
                                           const std::vector<PhotoCrop>& photos);
  /// Of each asset the mean grey of what it covers.
  std::vector<double> brightness(const std::vector<NewAsset>& assets);
  const FeatureNetwork& network() const { return network_; }

 private:
  /// Calls `numbers` with each of `count` assets; what it returns of them, in their order.
  std::vector<std::vector<double>> share(std::size_t count,
                                         const std::function<std::vector<double>(std::size_t)>& numbers);
  /// number: in all, from 1 on.
  void tell(std::size_t number);
  struct Views {
    int pixels;
    double height;
    bool framed;  // as crops are
  };
  std::vector<Picture> views_of(const NewAsset& asset, const Views& how);
  Eigen::MatrixXd features_around(const std::vector<NewAsset>& assets, const Views& how);

  Street& street_;
  ShowsAssets& shows_;
  const FeatureNetwork& network_;
  std::size_t shown_ = 0, told_ = 0, expected_;
  const Listener& listener_;
  const Ranks& ranks_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace cloam
