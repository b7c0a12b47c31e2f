// See eval_report.h. Keys are documented in docs/formats.md.
#include "cli/eval_report.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "cli/set_report.h"
#include "models/io/commit.h"
#include "models/street/lidar_rays.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;

struct Figure {
  const char* key;
  double (*of)(const ImageScore&);
};

const Figure kPsnr = {"psnr", [](const ImageScore& i) { return i.psnr; }};
const Figure kSsim = {"ssim", [](const ImageScore& i) { return i.ssim; }};
const Figure kFull = {"psnr_full", [](const ImageScore& i) { return i.psnr_full; }};
const Figure kActors = {"masked_psnr", [](const ImageScore& i) { return i.masked_psnr; }};
const Figure kActorsSsim = {"masked_ssim", [](const ImageScore& i) { return i.masked_ssim; }};
const std::vector<Figure> kFeatures = {
    {"feature_distance", [](const ImageScore& i) { return i.feature_distance; }},
    {"masked_feature_distance", [](const ImageScore& i) { return i.masked_feature_distance; }}};
const std::vector<Figure> kPhotoGuesses = {
    {"baseline_mean_colour_psnr", [](const ImageScore& i) { return i.guesses.mean_colour; }},
    {"baseline_nearest_frame_psnr", [](const ImageScore& i) { return i.guesses.nearest_frame; }}};
const std::vector<Figure> kLogGuesses = {
    {"baseline_mean_colour_psnr", [](const ImageScore& i) { return i.guesses.mean_colour; }},
    {"baseline_blend_psnr", [](const ImageScore& i) { return i.guesses.blend; }},
    {"baseline_blend_masked_psnr", [](const ImageScore& i) { return i.guesses.blend_masked; }},
    {"baseline_mean_masked_psnr", [](const ImageScore& i) { return i.guesses.mean_masked; }},
    {"baseline_copy_psnr", [](const ImageScore& i) { return i.guesses.copy; }},
    {"baseline_copy_masked_psnr", [](const ImageScore& i) { return i.guesses.copy_masked; }},
    {"baseline_row_mean_psnr", [](const ImageScore& i) { return i.guesses.row_mean; }}};

std::vector<Figure> figures_of(const EvalResult& result) {
  std::vector<Figure> figures = {kPsnr, kSsim};
  if (result.has_masks) figures.push_back(kFull);
  if (result.is_log) figures.insert(figures.end(), {kActors, kActorsSsim});
  if (!result.features.empty()) figures.insert(figures.end(), kFeatures.begin(), kFeatures.end());
  const std::vector<Figure>& guesses = result.is_log ? kLogGuesses : kPhotoGuesses;
  figures.insert(figures.end(), guesses.begin(), guesses.end());
  return figures;
}

std::vector<ImageScore> all_images(const EvalResult& result) {
  std::vector<ImageScore> images;
  for (const SceneResult& scene : result.scenes) images.insert(images.end(), scene.images.begin(), scene.images.end());
  return images;
}

std::vector<double> all_errors(const EvalResult& result) {
  std::vector<double> errors;
  for (const SceneResult& scene : result.scenes)
    errors.insert(errors.end(), scene.lidar_errors.begin(), scene.lidar_errors.end());
  return errors;
}

/// JSON has no infinity (equal images) and no NaN.
Report finite(double value) { return std::isfinite(value) ? Report(value) : Report(nullptr); }

void add_figures(Report& json, const EvalResult& result, const std::vector<ImageScore>& images,
                 const std::vector<double>& lidar_errors) {
  json["images"] = images.size();
  for (const Figure& figure : figures_of(result)) json[figure.key] = finite(mean_score(images, figure.of));
  if (result.is_log) json["lidar_median_error_m"] = finite(median_error(lidar_errors));
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

std::vector<double> columns(const EvalResult& result, const std::vector<ImageScore>& images,
                            const std::vector<double>& errors) {
  std::vector<double> values = {mean_score(images, kPsnr.of), mean_score(images, kSsim.of)};
  if (result.is_log)
    for (const double value :
         {mean_score(images, kActors.of), mean_score(images, kActorsSsim.of), median_error(errors)})
      values.push_back(value);
  return values;
}

std::string log_rows(const EvalResult& result) {
  std::string out = fmt::format("{:<38}  {:>8}  {:>8}  {:>8}  {:>8}  {:>8}\n", "log (masked: over actors only)", "PSNR",
                                "SSIM", "masked", "SSIM", "LiDAR m");
  for (const SceneResult& scene : result.scenes)
    out += row(scene.name, columns(result, scene.images, scene.lidar_errors));
  return out;
}

std::string image_rows(const EvalResult& result) {
  std::string out = fmt::format("{:<38}  {:>8}  {:>8}\n", "image", "PSNR", "SSIM");
  for (const ImageScore& image : all_images(result)) out += row(image.name, {image.psnr, image.ssim});
  return out;
}

/// Full-frame in the column of PSNR, over actors in that of masked PSNR.
std::string guess_rows(const EvalResult& result, const std::vector<ImageScore>& images) {
  const auto mean = [&](auto of) { return mean_score(images, of); };
  using Score = const ImageScore&;
  std::string out = row("baseline: mean colour of training", {mean([](Score i) { return i.guesses.mean_colour; })});
  if (!result.is_log)
    return out + row("baseline: nearest training photo", {mean([](Score i) { return i.guesses.nearest_frame; })});
  out += row("baseline: blend of two neighbours", {mean([](Score i) { return i.guesses.blend; }), kNoScore,
                                                   mean([](Score i) { return i.guesses.blend_masked; })});
  out += row("baseline: copy of the nearest photo", {mean([](Score i) { return i.guesses.copy; }), kNoScore,
                                                     mean([](Score i) { return i.guesses.copy_masked; })});
  out += row("baseline: mean colour of each row", {mean([](Score i) { return i.guesses.row_mean; })});
  return out + row("baseline: true mean colour of actors",
                   {kNoScore, kNoScore, mean([](Score i) { return i.guesses.mean_masked; })});
}

}  // namespace

nlohmann::ordered_json to_json(const EvalResult& result) {
  Report json = {{"schema_version", 1}, {"protocol", result.protocol}};
  if (!result.train_protocol.empty()) json["train_protocol"] = result.train_protocol;
  add_figures(json, result, all_images(result), all_errors(result));
  if (result.is_log) json["masks"] = source_of_masks(result);
  if (!result.features.empty()) json["feature_network"] = result.features;
  if (result.sets) add_sets(json, result.features, *result.sets);
  json["method"] = result.method;
  json["preset"] = result.preset;
  json["step"] = result.step;
  json["downscale"] = result.downscale;
  json["seconds"] = result.seconds;
  if (!result.is_log) return json;
  json["logs"] = Report::array();
  for (const SceneResult& scene : result.scenes) {
    Report log = {{"name", scene.name}};
    add_figures(log, result, scene.images, scene.lidar_errors);
    json["logs"].push_back(log);
  }
  return json;
}

void write_reports(const std::filesystem::path& folder, const EvalResult& result) {
  Report json = to_json(result);
  const std::vector<Figure> figures = figures_of(result);
  std::string csv = result.is_log ? "log,image" : "image";
  for (const Figure& figure : figures) csv += std::string(",") + figure.key;
  json["per_image"] = Report::array();
  for (const SceneResult& scene : result.scenes) {
    for (const ImageScore& image : scene.images) {
      Report one = {{"image", image.name}};
      if (result.is_log) one["log"] = scene.name;
      csv += "\n" + (result.is_log ? csv_word(scene.name) + "," : "") + csv_word(image.name);
      for (const Figure& figure : figures) {
        one[figure.key] = finite(figure.of(image));
        csv += text(",", figure.of(image));
      }
      json["per_image"].push_back(one);
    }
  }
  commit_text(folder / "per_image.csv", csv + "\n");
  commit_text(folder / "eval.json", json.dump(2, ' ', false, Report::error_handler_t::replace) + "\n");
}

std::string table(const EvalResult& result) {
  const std::vector<ImageScore> images = all_images(result);
  std::string out = text("protocol ", result.protocol, ", ", images.size(), " images, step ", result.step, "\n");
  out += result.is_log ? log_rows(result) : image_rows(result);
  out += row("mean", columns(result, images, all_errors(result)));
  if (result.has_masks) out += row("mean over all pixels, masked or not", {mean_score(images, kFull.of)});
  for (const Figure& figure : kFeatures)
    if (!result.features.empty())
      out += text(figure.key, " (", result.features, "): ", mean_score(images, figure.of), "\n");
  if (result.sets) out += "renders against source images, actors only:\n" + set_lines(result.features, *result.sets);
  return out + guess_rows(result, images);
}

}  // namespace cloam
