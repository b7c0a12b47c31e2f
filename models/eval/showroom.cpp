// See showroom.h.
#include "models/eval/showroom.h"

#include "models/eval/evaluate.h"
#include "models/io/words.h"
#include "models/metrics/feature_distance.h"
#include "models/scene/orbit.h"
#include "models/train/capability.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kPixels = 64;
constexpr std::size_t kToldAtMost = 64;  // assets from one line of progress to the next

/// An asset's picture on white, cut as masks cut crops of photographs: a pixel is the asset's or none of it.
std::vector<float> cut_out(const Picture& picture) {
  std::vector<float> rgb(picture.rgb.size(), 1.f);
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    const float opacity = picture.opacity[i / 3];
    if (opacity >= 0.5f) rgb[i] = (picture.rgb[i] - (1 - opacity)) / opacity;
  }
  return rgb;
}

/// Into a row of `rows`, which gets its size from the first.
void put_row(Eigen::MatrixXd& rows, Eigen::Index at, std::size_t count, const Eigen::MatrixXd& row) {
  if (rows.size() == 0) rows.resize(static_cast<Eigen::Index>(count), row.cols());
  rows.row(at) = row;
}

}  // namespace

Showroom::Showroom(Method& decoder, const FeatureNetwork& network, std::size_t expected, const Listener& listener)
    : street_(*as<Street>(decoder)),
      shows_(*as<ShowsAssets>(decoder)),
      network_(network),
      expected_(expected),
      listener_(listener) {}

AssetName Showroom::show(const NewAsset& asset) {
  listener_.check_stop(
      [&] { return text(shown_, " of ", expected_, " assets were measured; no metrics were written"); });
  const AssetName name = shows_.show_assets({asset}).front();
  if (++shown_ % kToldAtMost != 0 && shown_ != expected_) return name;
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  const double left = seconds / static_cast<double>(shown_) * static_cast<double>(expected_ - shown_);
  listener_.say(text("eval ", shown_, "/", expected_, " assets  left ", words_for_seconds(left)));
  return name;
}

std::vector<Picture> Showroom::views_of(const NewAsset& asset, const Views& how) {
  const Camera camera = turntable_camera(how.pixels, how.pixels);
  const AssetName name = show(asset);
  std::vector<Picture> views;
  for (const Eigen::Matrix4d& pose : turntable_poses(asset.size, camera, kViews, how.height))
    views.push_back(street_.render_asset(name, how.framed ? framed(camera, pose, asset.size) : camera, pose));
  return views;
}

Eigen::MatrixXd Showroom::features_around(const std::vector<NewAsset>& assets, const Views& how) {
  Eigen::MatrixXd rows;
  Eigen::Index at = 0;
  for (const NewAsset& asset : assets)
    for (const Picture& picture : views_of(asset, how))
      put_row(rows, at++, assets.size() * kViews,
              pooled_features(network_, as_batch(how.framed ? cut_out(picture) : picture.rgb, how.pixels, how.pixels)));
  return rows;
}

Eigen::MatrixXd Showroom::features_of(const std::vector<NewAsset>& assets) {
  return features_around(assets, {kPixels, kTurntableHeight, false});
}

Eigen::MatrixXd Showroom::features_as_crops(const std::vector<NewAsset>& assets, int pixels, double height) {
  return features_around(assets, {pixels, height, true});
}

Eigen::MatrixXd Showroom::features_as_photographed(const std::vector<NewAsset>& assets,
                                                   const std::vector<std::size_t>& shown,
                                                   const std::vector<PhotoCrop>& photos) {
  Eigen::MatrixXd rows;
  std::vector<std::vector<std::size_t>> photos_of(assets.size());
  for (std::size_t i = 0; i < photos.size(); ++i) photos_of[shown[i]].push_back(i);
  for (std::size_t a = 0; a < assets.size(); ++a) {
    if (photos_of[a].empty()) continue;
    const AssetName name = show(assets[a]);
    for (const std::size_t i : photos_of[a]) {
      const Camera& camera = photos[i].camera;
      const Picture picture = street_.render_asset(name, camera, pose_for(assets[a].size, photos[i]));
      put_row(rows, static_cast<Eigen::Index>(i), photos.size(),
              pooled_features(network_, as_batch(cut_out(picture), camera.width, camera.height)));
    }
  }
  return rows;
}

double Showroom::brightness(const NewAsset& asset) {
  double light = 0, covered = 1e-9;
  for (const Picture& picture : views_of(asset, {kPixels, kTurntableHeight, false}))
    for (std::size_t i = 0; i < picture.opacity.size(); ++i) {
      const double opacity = double{picture.opacity[i]};
      for (std::size_t c = 0; c < 3; ++c) light += (double{picture.rgb[3 * i + c]} - (1 - opacity)) / 3;
      covered += opacity;
    }
  return light / covered;
}

}  // namespace cloam
