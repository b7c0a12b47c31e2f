// See run_pictures.h.
#include "cli/run_pictures.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "cli/render_views.h"
#include "cli/stop_signal.h"
#include "models/eval/actor_list.h"
#include "models/eval/asset_files.h"
#include "models/eval/pictures.h"
#include "models/io/gif.h"
#include "models/runs/actor_names.h"
#include "models/scene/asset_class.h"
#include "models/scene/camera_path.h"
#include "models/scene/orbit.h"
#include "models/train/renders_views.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;

constexpr int kFrames = 36, kGood = 18, kFewestFrames = 8, kTurntableRate = 12;
constexpr int kLargestView = 240, kLeastView = 80;    // pixels of a view's longer side
constexpr int kAssetPixels = 128, kSheetColumns = 6;  // of turntables of assets and of sheets
constexpr std::size_t kMostActors = 24;
constexpr int kGeneratedAssets = 8, kGeneratedColumns = 4, kDenoisingSteps = 20;

Camera with_sides(const Camera& camera, double scale) {
  const auto side = [&](int pixels) { return std::max(1, static_cast<int>(std::lround(scale * pixels))); };
  return resized(camera, side(camera.width), side(camera.height));
}

/// A film of one frame after the other: shown(camera, i, count) is frame i of so many. Where all would take longer than
/// `seconds`, told from a few pixels, the frames get smaller, then fewer. Empty where even kFewestFrames would take
/// longer.
template <class Shown>
std::vector<Image> film(const Camera& wanted, double seconds, const Shown& shown) {
  const double start = steady_seconds();
  const auto check = [] {
    check_stop([] { return std::string("the run is whole, but not all of its pictures were made"); });
  };
  double each = 0;
  const double least = std::min(1.0, static_cast<double>(kLeastView) / std::max(wanted.width, wanted.height));
  const Camera few = with_sides(wanted, least);
  for (int tries = 0; tries < 2; ++tries) {  // the first may compile kernels
    check();
    const double begun = steady_seconds();
    shown(few, 0, kFrames);
    each = std::max(1e-6, (steady_seconds() - begun) / (least * least));
    if (each * least * least > seconds) return {};
  }
  const double left = seconds - (steady_seconds() - start);
  const double scale = std::clamp(std::sqrt(std::max(0.0, left) / (kGood * each)), least, 1.0);
  const Camera camera = with_sides(wanted, scale);
  const int count = static_cast<int>(std::clamp(left / (each * scale * scale), 0.0, static_cast<double>(kFrames)));
  if (count < kFewestFrames) return {};
  std::vector<Image> images;
  for (int i = 0; i < count; ++i) {
    check();
    images.push_back(shown(camera, i, count));
  }
  return images;
}

/// Writes a film; of no images nothing.
void write(const std::vector<Image>& images, const fs::path& path, const Common& common,
           std::vector<fs::path>& written) {
  if (images.empty())
    return say(common,
               text("no ", path.filename().string(), ": it would take too long now; cloam report makes it later"));
  write_gif(path, images, kTurntableRate);
  written.push_back(path);
}

Camera small_camera(const RestoredRun& run, const Scene& scene, const Frame& frame) {
  const Camera camera = scaled(scene.cameras[static_cast<std::size_t>(frame.camera)], run.record.reading.downscale);
  const double scale = std::min(1.0, static_cast<double>(kLargestView) / std::max(camera.width, camera.height));
  return with_sides(camera, scale);
}

Image shown(RestoredRun& run, const View& view) {
  const Picture picture = as<RendersViews>(*run.method)->render(view);
  return to_image(picture.rgb, picture.width, picture.height);
}

std::vector<Image> orbit(RestoredRun& run, double seconds) {
  const Scene& scene = run.scenes.front();
  const Frame& first = scene.frames.front();
  return film(small_camera(run, scene, first), seconds, [&](const Camera& camera, int i, int count) {
    const auto pose = orbit_poses(scene, count)[static_cast<std::size_t>(i)];
    return shown(run, {camera, pose, 0, first.timestamp.value_or(0)});
  });
}

/// Along the way of the first log's front camera.
std::vector<Image> drive(RestoredRun& run, double seconds) {
  const Scene& scene = run.scenes.front();
  const std::vector<Frame> stops = frames_in_order(scene, front_sensor(scene));
  return film(small_camera(run, scene, stops.front()), seconds, [&](const Camera& camera, int i, int count) {
    const CameraMoment moment = interpolated_path(stops, count)[static_cast<std::size_t>(i)];
    return shown(run, {camera, moment.world_from_camera, 0, moment.time});
  });
}

struct ShownAsset {
  AssetName name;
  Eigen::Vector3d size;
  Caption caption;
};

/// The actors that most images show.
std::vector<ShownAsset> actors_of(const RestoredRun& run) {
  const Report list = list_of_actors(run);
  std::vector<std::pair<int64_t, ShownAsset>> actors;
  std::size_t place = 0;
  for (std::size_t log = 0; log < run.scenes.size(); ++log)
    for (const Actor& actor : run.scenes[log].actors) {
      const Report& row = list.at("actors").at(place++);
      if (actor.boxes.empty()) continue;  // removed
      actors.push_back({row.at("images"),
                        {actor.asset.value_or(AssetName{static_cast<int>(log), actor.id}),
                         actor.size,
                         {row.at("short_id").get<std::string>(), actor.label}}});
    }
  std::stable_sort(actors.begin(), actors.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<ShownAsset> most;
  for (std::size_t i = 0; i < std::min(kMostActors, actors.size()); ++i) most.push_back(actors[i].second);
  return most;
}

/// The sheet, cut to as many as there is time for, and the first all around.
void show_assets(Street& street, const std::vector<ShownAsset>& assets, int columns, double seconds,
                 const fs::path& run, const Common& common, std::vector<fs::path>& written) {
  const double begun = steady_seconds();
  std::vector<Image> images;
  std::vector<Caption> captions;
  for (const ShownAsset& asset : assets) {
    images.push_back(three_quarter_picture(street, asset.name, asset.size, kAssetPixels));
    captions.push_back(asset.caption);
    if (steady_seconds() - begun > seconds / 2) break;
  }
  if (images.empty()) return;
  write_png(RunPaths{run}.assets(), contact_sheet(images, columns, captions));
  written.push_back(RunPaths{run}.assets());
  const ShownAsset& first = assets.front();
  const Camera square = turntable_camera(kAssetPixels, kAssetPixels);
  const std::vector<Image> turn = film(square, seconds / 2, [&](const Camera& camera, int i, int count) {
    const Picture picture = street.render_asset(
        first.name, camera, turntable_poses(first.size, camera, count)[static_cast<std::size_t>(i)]);
    return to_image(picture.rgb, picture.width, picture.height);
  });
  write(turn, RunPaths{run}.turntable(), common, written);
}

void show_generated(const RestoredRun& prior, double seconds, const Common& common, std::vector<fs::path>& written) {
  const Generation made(prior, {.count = kGeneratedAssets, .steps = kDenoisingSteps}, {kVersion, "sampled"});
  std::vector<ShownAsset> assets;
  for (std::size_t i = 0; i < made.assets().size(); ++i) {
    const NewAsset& asset = made.assets()[i];
    assets.push_back({made.names()[i], asset.size, {kAssetClasses[asset.asset_class], asset.night ? "night" : "day"}});
  }
  show_assets(made.street(), assets, kGeneratedColumns, seconds, prior.folder, common, written);
}

}  // namespace

std::vector<fs::path> make_pictures(RestoredRun& run, double seconds, const Common& common) {
  std::vector<fs::path> written;
  const RunPaths paths{run.folder};
  auto* street = dynamic_cast<Street*>(run.method.get());
  if (learned_from_run(run.record)) {
    show_generated(run, seconds, common, written);
  } else if (street) {
    write(drive(run, seconds / 2), paths.drive(), common, written);
    show_assets(*street, actors_of(run), kSheetColumns, seconds / 2, run.folder, common, written);
  } else if (as<RendersViews>(*run.method)) {
    write(orbit(run, seconds), paths.turntable(), common, written);
  }
  return written;
}

}  // namespace cloam
