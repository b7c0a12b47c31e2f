// See showroom.h.
#include "models/eval/showroom.h"

#include <span>

#include "models/eval/evaluate.h"
#include "models/io/words.h"
#include "models/metrics/feature_distance.h"
#include "models/runs/shared_work.h"
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

std::vector<double> as_numbers(const Eigen::MatrixXd& row) { return {row.data(), row.data() + row.size()}; }

/// Into a row of `rows`, which gets its size from the first.
void put_row(Eigen::MatrixXd& rows, std::size_t at, std::size_t count, std::span<const double> row) {
  const auto width = static_cast<Eigen::Index>(row.size());
  if (rows.size() == 0) rows.resize(static_cast<Eigen::Index>(count), width);
  rows.row(static_cast<Eigen::Index>(at)) = Eigen::Map<const Eigen::RowVectorXd>(row.data(), width);
}

}  // namespace

Showroom::Showroom(Method& decoder, const FeatureNetwork& network, std::size_t expected, const Listener& listener,
                   const Ranks& ranks)
    : street_(*as<Street>(decoder)),
      shows_(*as<ShowsAssets>(decoder)),
      network_(network),
      expected_(expected),
      listener_(listener),
      ranks_(ranks) {}

std::vector<std::vector<double>> Showroom::share(std::size_t count,
                                                 const std::function<std::vector<double>(std::size_t)>& numbers) {
  const auto make = [&](std::size_t item) {
    auto made = packed(numbers(item));
    tell(shown_ + item + 1);
    return made;
  };
  const auto complete = [&](std::size_t done) {
    return text(shown_ + done, " of ", expected_, " assets were measured; no metrics were written");
  };
  std::vector<std::vector<double>> all;
  for (const auto& made : share_out(ranks_, listener_, {count, make, complete})) all.push_back(unpacked<double>(made));
  shown_ += count;
  return all;
}

void Showroom::tell(std::size_t number) {
  if (number / kToldAtMost == told_ && number != expected_) return;
  told_ = number / kToldAtMost;
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  const double left = seconds / static_cast<double>(number) * static_cast<double>(expected_ - number);
  listener_.say(text("eval ", number, "/", expected_, " assets  left ", words_for_seconds(left)));
}

std::vector<Picture> Showroom::views_of(const NewAsset& asset, const Views& how) {
  const Camera camera = turntable_camera(how.pixels, how.pixels);
  const AssetName name = shows_.show_assets({asset}).front();
  std::vector<Picture> views;
  for (const Eigen::Matrix4d& pose : turntable_poses(asset.size, camera, kViews, how.height))
    views.push_back(street_.render_asset(name, how.framed ? framed(camera, pose, asset.size) : camera, pose));
  return views;
}

Eigen::MatrixXd Showroom::features_around(const std::vector<NewAsset>& assets, const Views& how) {
  const auto rows_of = [&](std::size_t item) {
    std::vector<double> numbers;  // of a view, then of the next
    for (const Picture& picture : views_of(assets[item], how)) {
      const std::vector<float> rgb = how.framed ? cut_out(picture) : picture.rgb;
      const std::vector<double> row = as_numbers(pooled_features(network_, as_batch(rgb, how.pixels, how.pixels)));
      numbers.insert(numbers.end(), row.begin(), row.end());
    }
    return numbers;
  };
  Eigen::MatrixXd rows;
  std::size_t at = 0;
  for (const std::vector<double>& numbers : share(assets.size(), rows_of)) {
    const std::size_t width = numbers.size() / kViews;
    for (std::size_t view = 0; view < kViews; ++view)
      put_row(rows, at++, assets.size() * kViews, std::span(numbers).subspan(view * width, width));
  }
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
  std::vector<std::vector<std::size_t>> photos_of(assets.size());
  for (std::size_t i = 0; i < photos.size(); ++i) photos_of[shown[i]].push_back(i);
  std::vector<std::size_t> named;
  for (std::size_t a = 0; a < assets.size(); ++a)
    if (!photos_of[a].empty()) named.push_back(a);
  const auto rows_of = [&](std::size_t item) {
    const NewAsset& asset = assets[named[item]];
    const AssetName name = shows_.show_assets({asset}).front();
    std::vector<double> numbers;  // of a photo, then of the next
    for (const std::size_t i : photos_of[named[item]]) {
      const Camera& camera = photos[i].camera;
      const Picture picture = street_.render_asset(name, camera, pose_for(asset.size, photos[i]));
      const std::vector<double> row =
          as_numbers(pooled_features(network_, as_batch(cut_out(picture), camera.width, camera.height)));
      numbers.insert(numbers.end(), row.begin(), row.end());
    }
    return numbers;
  };
  const std::vector<std::vector<double>> all = share(named.size(), rows_of);
  Eigen::MatrixXd rows;
  for (std::size_t item = 0; item < named.size(); ++item) {
    const std::vector<std::size_t>& of_asset = photos_of[named[item]];
    const std::size_t width = all[item].size() / of_asset.size();
    for (std::size_t i = 0; i < of_asset.size(); ++i)
      put_row(rows, of_asset[i], photos.size(), std::span(all[item]).subspan(i * width, width));
  }
  return rows;
}

std::vector<double> Showroom::brightness(const std::vector<NewAsset>& assets) {
  const auto grey_of = [&](std::size_t item) {
    double light = 0, covered = 1e-9;
    for (const Picture& picture : views_of(assets[item], {kPixels, kTurntableHeight, false}))
      for (std::size_t i = 0; i < picture.opacity.size(); ++i) {
        const double opacity = double{picture.opacity[i]};
        for (std::size_t c = 0; c < 3; ++c) light += (double{picture.rgb[3 * i + c]} - (1 - opacity)) / 3;
        covered += opacity;
      }
    return std::vector<double>{light / covered};
  };
  std::vector<double> greys;
  for (const std::vector<double>& grey : share(assets.size(), grey_of)) greys.push_back(grey.front());
  return greys;
}

}  // namespace cloam
