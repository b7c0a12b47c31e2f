// See report.h. Keys are documented in docs/formats.md.
#include "models/eval/report.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "models/eval/image_sets.h"
#include "models/io/commit.h"
#include "models/metrics/lpips.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;

struct ImageFigure {
  std::string key;
  std::function<double(const ImageScore&)> of;
};

ImageFigure baseline(const char* key, double BaselineScores::*figure) {
  return {key, [=](const ImageScore& image) { return image.baselines.*figure; }};
}

std::vector<ImageFigure> figures_of(const EvalResult& result) {
  std::vector<ImageFigure> figures = {{"psnr", &ImageScore::psnr}, {"ssim", &ImageScore::ssim}};
  const auto add = [&](const std::vector<ImageFigure>& more) {
    figures.insert(figures.end(), more.begin(), more.end());
  };
  if (result.has_masks) add({{"psnr_full", &ImageScore::psnr_full}});
  if (result.is_log)
    add({{"masked_psnr", &ImageScore::masked_psnr},
         {"masked_ssim", &ImageScore::masked_ssim},
         {"moving_psnr", &ImageScore::moving_psnr},
         {"outline_iou", &ImageScore::overlap}});
  if (!result.features.empty())
    add({{"feature_distance", &ImageScore::feature_distance},
         {"masked_feature_distance", &ImageScore::masked_feature_distance}});
  if (!result.perceptual.empty())
    add({{lpips_key(result.perceptual), &ImageScore::lpips},
         {"masked_" + lpips_key(result.perceptual), &ImageScore::masked_lpips}});
  add({baseline("baseline_mean_colour_psnr", &BaselineScores::mean_colour)});
  if (!result.is_log) add({baseline("baseline_nearest_frame_psnr", &BaselineScores::nearest_frame)});
  if (result.is_log)
    add({baseline("baseline_blend_psnr", &BaselineScores::blend),
         baseline("baseline_blend_masked_psnr", &BaselineScores::blend_masked),
         baseline("baseline_blend_moving_psnr", &BaselineScores::blend_moving),
         baseline("baseline_mean_masked_psnr", &BaselineScores::mean_masked),
         baseline("baseline_mean_moving_psnr", &BaselineScores::mean_moving),
         baseline("baseline_copy_psnr", &BaselineScores::copy),
         baseline("baseline_copy_masked_psnr", &BaselineScores::copy_masked),
         baseline("baseline_copy_moving_psnr", &BaselineScores::copy_moving),
         baseline("baseline_row_mean_psnr", &BaselineScores::row_mean),
         {"baseline_box_outline_iou", &ImageScore::box_overlap}});
  return figures;
}

/// JSON has no infinity (equal images) and no NaN.
Report finite(double value) { return std::isfinite(value) ? Report(value) : Report(nullptr); }

void add_figures(Report& json, const EvalResult& result, const std::vector<ImageScore>& images,
                 const LidarScores& lidar) {
  json["images"] = images.size();
  for (const ImageFigure& figure : figures_of(result)) json[figure.key] = finite(mean_score(images, figure.of));
  if (!result.is_log) return;
  json["lidar_median_error_m"] = finite(lidar.median_error());
  json["lidar_chamfer_m2"] = finite(lidar.mean_chamfer());
  if (lidar.drops.empty()) return;
  json["lidar_median_squared_error_m2"] = finite(lidar.median_error() * lidar.median_error());
  json["lidar_intensity_rmse"] = finite(lidar.intensity_rmse());
  json["baseline_mean_intensity_rmse"] = finite(lidar.mean_intensity_rmse());
  json["ray_drop_accuracy"] = finite(lidar.drop_accuracy());
  json["ray_drop_balanced_accuracy"] = finite(lidar.balanced_drop_accuracy());
  json["baseline_ray_drop_accuracy"] = finite(lidar.usual_drop_share());
}

bool is_rotate360(const EvalResult& result) { return result.protocol == "rotate360"; }

/// Runs train on the images that 0 degrees are measured on: what is turned alone.
Report without_0(const EvalResult& result) {
  std::vector<ImageScore> images = all_images(result);
  std::erase_if(images, [](const ImageScore& image) { return image.degrees == 0; });
  Report json = {{"images", images.size()}};
  for (const ImageFigure& figure : figures_of(result)) json[figure.key] = finite(mean_score(images, figure.of));
  if (result.sets_without_0) add_sets(json, result.features, *result.sets_without_0);
  return json;
}

const char* source_of_masks(const EvalResult& result) {
  std::size_t images = 0, from_truth = 0;
  for (const SceneResult& scene : result.scenes) {
    images += scene.images.size();
    from_truth += scene.truth_masks;
  }
  return from_truth == images ? "truth" : from_truth == 0 ? "boxes" : "truth and boxes";
}

std::string csv_word(const std::string& word) {
  std::string out = "\"";
  for (const char c : word) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

/// A row for each actor of each image.
std::string actor_rows(const EvalResult& result) {
  std::string csv = text("log,image,", is_rotate360(result) ? "degrees," : "",
                         "actor,label,moves,pixels,psnr,baseline_mean_psnr,view_degrees\n");
  for (const SceneResult& scene : result.scenes)
    for (const ImageScore& image : scene.images)
      for (const ActorFigures& figures : image.actors) {
        const MeasuredActor& actor = scene.actors.at(static_cast<std::size_t>(figures.actor));
        csv += csv_word(scene.name) + "," + csv_word(image.name) + ",";
        if (is_rotate360(result)) csv += text(image.degrees.value_or(0), ",");
        csv += text(csv_word(actor.id), ",", csv_word(actor.label), ",", actor.moves ? 1 : 0, ",", figures.pixels, ",",
                    figures.psnr, ",", figures.mean_psnr, ",", figures.view_degrees, "\n");
      }
  return csv;
}

}  // namespace

std::vector<MeasuredActor> measured_actors(const Scene& scene) {
  std::vector<MeasuredActor> actors;
  for (const Actor& actor : scene.actors) actors.push_back({actor.id, actor.label, goes_somewhere(actor)});
  return actors;
}

std::vector<ImageScore> all_images(const EvalResult& result) {
  std::vector<ImageScore> images;
  for (const SceneResult& scene : result.scenes) images.insert(images.end(), scene.images.begin(), scene.images.end());
  return images;
}

LidarScores all_lidar(const EvalResult& result) {
  LidarScores all;
  for (const SceneResult& scene : result.scenes) all.add(scene.lidar);
  return all;
}

nlohmann::ordered_json to_json(const EvalResult& result) {
  Report json = {{"schema_version", kEvalSchema}, {"protocol", result.protocol}};
  if (!result.train_protocol.empty()) json["train_protocol"] = result.train_protocol;
  add_figures(json, result, all_images(result), all_lidar(result));
  if (result.is_log) json["masks"] = source_of_masks(result);
  if (!result.features.empty()) json["feature_network"] = result.features;
  if (!result.perceptual.empty()) json["perceptual_network"] = result.perceptual;
  if (result.sets) add_sets(json, result.features, *result.sets);
  if (is_rotate360(result)) json["without_0"] = without_0(result);
  json["method"] = result.method;
  json["preset"] = result.preset;
  json["step"] = result.step;
  json["downscale"] = result.downscale;
  json["seconds"] = result.seconds;
  if (!result.is_log) return json;
  json["logs"] = Report::array();
  for (const SceneResult& scene : result.scenes) {
    Report log = {{"name", scene.name}};
    add_figures(log, result, scene.images, scene.lidar);
    json["logs"].push_back(log);
  }
  return json;
}

void write_reports(const std::filesystem::path& folder, const EvalResult& result) {
  Report json = to_json(result);
  const std::vector<ImageFigure> figures = figures_of(result);
  std::string csv = result.is_log ? "log,image" : "image";
  if (is_rotate360(result)) csv += ",degrees";
  for (const ImageFigure& figure : figures) csv += "," + figure.key;
  json["per_image"] = Report::array();
  for (const SceneResult& scene : result.scenes) {
    for (const ImageScore& image : scene.images) {
      Report one = {{"image", image.name}};
      if (result.is_log) one["log"] = scene.name;
      if (image.degrees) one["degrees"] = *image.degrees;
      csv += "\n" + (result.is_log ? csv_word(scene.name) + "," : "") + csv_word(image.name);
      if (is_rotate360(result)) csv += "," + (image.degrees ? std::to_string(*image.degrees) : "");
      for (const ImageFigure& figure : figures) {
        one[figure.key] = finite(figure.of(image));
        csv += text(",", figure.of(image));
      }
      json["per_image"].push_back(one);
    }
  }
  commit_text(folder / "per_image.csv", csv + "\n");
  if (result.is_log) commit_text(folder / "per_actor.csv", actor_rows(result));
  commit_text(folder / "eval.json", json.dump(2, ' ', false, Report::error_handler_t::replace) + "\n");
}

}  // namespace cloam
