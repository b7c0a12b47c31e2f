// What an evaluation found, as tables for people.

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "cli/eval.h"
#include "models/eval/image_sets.h"
#include "models/metrics/lpips.h"
#include "runtime/error.h"

namespace cloam {
namespace {

std::string row(const std::string& name, const std::vector<double>& values) {
  std::string line = fmt::format("{:<38.38}", name);
  for (const double value : values) {
    if (std::isnan(value))
      line += fmt::format("  {:>8}", "-");
    else
      line += std::abs(value) < 1 ? fmt::format("  {:>8.4f}", value) : fmt::format("  {:>8.2f}", value);
  }
  return line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
}

std::vector<double> columns(const EvalResult& result, const std::vector<ImageScore>& images, const LidarScores& lidar) {
  std::vector<double> values = {mean_score(images, &ImageScore::psnr), mean_score(images, &ImageScore::ssim)};
  if (result.is_log)
    values.insert(values.end(),
                  {mean_score(images, &ImageScore::masked_psnr), mean_score(images, &ImageScore::masked_ssim),
                   mean_score(images, &ImageScore::moving_psnr), lidar.median_error(), lidar.mean_chamfer()});
  return values;
}

std::string log_rows(const EvalResult& result) {
  std::string out =
      fmt::format("{:<38}  {:>8}  {:>8}  {:>8}  {:>8}  {:>8}  {:>8}  {:>10}\n", "log (masked: over actors only)",
                  "PSNR", "SSIM", "masked", "SSIM", "moving", "LiDAR m", "Chamfer m2");
  for (const SceneResult& scene : result.scenes) out += row(scene.name, columns(result, scene.images, scene.lidar));
  return out;
}

std::string image_rows(const EvalResult& result) {
  std::string out = fmt::format("{:<38}  {:>8}  {:>8}\n", "image", "PSNR", "SSIM");
  for (const ImageScore& image : all_images(result)) out += row(image.name, {image.psnr, image.ssim});
  return out;
}

/// Full-frame in the column of PSNR, over actors in that of masked PSNR, over moving ones in theirs.
std::string guess_rows(const EvalResult& result, const std::vector<ImageScore>& images) {
  const auto mean = [&](double BaselineScores::*figure) {
    return mean_score(images, [=](const ImageScore& image) { return image.baselines.*figure; });
  };
  std::string out = row("baseline: mean colour of training", {mean(&BaselineScores::mean_colour)});
  if (!result.is_log) return out + row("baseline: nearest training photo", {mean(&BaselineScores::nearest_frame)});
  return out +
         row("baseline: blend of two neighbours",
             {mean(&BaselineScores::blend), kNoScore, mean(&BaselineScores::blend_masked), kNoScore,
              mean(&BaselineScores::blend_moving)}) +
         row("baseline: copy of the nearest photo",
             {mean(&BaselineScores::copy), kNoScore, mean(&BaselineScores::copy_masked), kNoScore,
              mean(&BaselineScores::copy_moving)}) +
         row("baseline: mean colour of each row", {mean(&BaselineScores::row_mean)}) +
         row("baseline: true mean colour of actors",
             {kNoScore, kNoScore, mean(&BaselineScores::mean_masked), kNoScore, mean(&BaselineScores::mean_moving)});
}

std::string outline_row(const std::vector<ImageScore>& images) {
  const double overlap = mean_score(images, &ImageScore::overlap);
  if (std::isnan(overlap)) return "";
  return fmt::format("outlines of actors, overlap with the true masks (IoU): {:.3f}; of their boxes {:.3f}\n", overlap,
                     mean_score(images, &ImageScore::box_overlap));
}

/// Of methods that know intensities and ray drop.
std::string lidar_rows(const LidarScores& lidar) {
  if (lidar.drops.empty()) return "";
  return fmt::format(
      "LiDAR intensity, RMSE: {:.3f}; of the mean intensity {:.3f}\n"
      "ray drop: {:.1f} % right, balanced {:.1f} %; guessing the more frequent kind {:.1f} %, 50 %\n",
      lidar.intensity_rmse(), lidar.mean_intensity_rmse(), 100 * lidar.drop_accuracy(),
      100 * lidar.balanced_drop_accuracy(), 100 * lidar.usual_drop_share());
}

}  // namespace

std::string table(const EvalResult& result) {
  const std::vector<ImageScore> images = all_images(result);
  std::string out = text("protocol ", result.protocol, ", ", images.size(), " images, step ", result.step,
                         result.downscale > 1 ? text(", photos shrunk by ", result.downscale) : "", "\n");
  out += result.is_log ? log_rows(result) : image_rows(result);
  out += row("mean", columns(result, images, all_lidar(result)));
  if (result.has_masks) out += row("mean over all pixels, masked or not", {mean_score(images, &ImageScore::psnr_full)});
  out += outline_row(images) + lidar_rows(all_lidar(result));
  const auto distances = [&](const std::string& key, const std::string& network, double ImageScore::*whole,
                             double ImageScore::*actors) {
    out += text(key, " (", network, "): ", mean_score(images, whole), "\nmasked_", key, " (", network,
                "): ", mean_score(images, actors), "\n");
  };
  if (!result.features.empty())
    distances("feature_distance", result.features, &ImageScore::feature_distance, &ImageScore::masked_feature_distance);
  if (!result.perceptual.empty())
    distances(lpips_key(result.perceptual), result.perceptual, &ImageScore::lpips, &ImageScore::masked_lpips);
  if (result.sets) out += "renders against source images, actors only:\n" + set_lines(result.features, *result.sets);
  return out + guess_rows(result, images);
}

std::string prior_table(const nlohmann::ordered_json& f) {
  const auto row = [&](const std::string& what, const std::string& key) -> std::string {
    return f.contains(key) && f.at(key).is_number() ? fmt::format("{:<38}{:.4f}\n", what, f.at(key).get<double>()) : "";
  };
  const auto both = [&](const std::string& what, const std::string& prefix) {
    std::string rows;
    for (const std::string key : {"frechet_feature_distance", "fid", "kernel_feature_distance", "kid"}) {
      const bool frechet = key[0] == 'f';
      rows += row(text(what, frechet ? ", Frechet" : ", kernel"), prefix + key);
    }
    return rows;
  };
  return fmt::format("{} codes held out, {} trained on, step {}\n", f.at("codes").get<int64_t>(),
                     f.at("training_codes").get<int64_t>(), f.at("step").get<int64_t>()) +
         row("v-loss", "v_loss") + row("v-loss of predicting zero", "baseline_zero_v_loss") +
         row("v-loss of the Wiener denoiser", "wiener_v_loss") + row("least possible v-loss", "floor_v_loss") +
         row("v-loss on the training codes", "training_v_loss") +
         row("relative distance to training codes", "copy_ratio") + both("distance to training assets", "") +
         both("  of Gaussian codes", "baseline_gaussian_") + both("  of random codes", "baseline_random_") +
         both("  of other training assets", "baseline_training_") + both("distance to photos", "photos_") +
         both("  of Gaussian codes", "photos_baseline_gaussian_") +
         both("  of random codes", "photos_baseline_random_") +
         both("  of training assets", "photos_baseline_training_") +
         row("beyond training, over the Gaussians'", "photos_frechet_ratio") +
         row("photos recognised as their class", "class_right_photos_held_out") +
         row("samples, by pictures alone", "class_right_pictures") +
         row("training assets, by pictures alone", "class_right_pictures_of_training") +
         row("samples, by box sides alone", "class_right_box") + row("by chance", "baseline_class_right") +
         row("nights darker than days", "night_darker");
}

}  // namespace cloam
