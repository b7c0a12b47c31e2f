// cloam check: is this folder a capture that can be trained? Every image is read, none is kept.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "models/data/check_log.h"
#include "models/data/colmap.h"
#include "models/data/read_scene.h"
#include "models/runs/captures.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kCheckExamples[] = R"(Check a capture and show what training would use.

Examples:
  cloam check data/fox
  cloam check data/fox --downscale 4 --holdout 8
  cloam check data/fox --json
  cloam check data/pandaset/001          # a driving log: also time stamps, boxes, LiDAR
  cloam check data/2011_09_26_drive_0005_sync)";

struct CheckRequest {
  std::string data, masks = "ignore";
  Reading how;
};

/// One image in memory at a time. Returns what is odd, each kind of remark once.
std::vector<std::string> check_images(const Scene& scene, const Reading& how) {
  std::vector<std::string> warnings;
  Scene single = scene;
  int odd = 0;  // in size or orientation
  for (const Frame& frame : scene.frames) {
    single.frames = {frame};
    const Pixels pixels = load_images(single, frame.split, {how.downscale, how.skip_bad, how.masks});
    if (pixels.frames.empty())
      warnings.insert(warnings.end(), pixels.warnings.begin(), pixels.warnings.end());
    else if (!pixels.warnings.empty() && odd++ == 0)
      warnings.push_back(pixels.warnings.front());
  }
  if (odd > 1) warnings.push_back(text("... and ", odd - 1, " more images like it"));
  return warnings;
}

nlohmann::ordered_json log_json(const LogReport& log) {
  nlohmann::ordered_json fits = nlohmann::ordered_json::array();
  for (const LidarFit& fit : log.fits) {
    fits.push_back({{"camera", fit.sensor},
                    {"images", fit.images},
                    {"points_per_image", fit.points_per_image},
                    {"share_worse", fit.share_worse},
                    {"best_offset_pixels", {fit.offset_x, fit.offset_y}}});
  }
  return {{"steps", log.steps},
          {"seconds", log.seconds},
          {"rate_hz", log.rate},
          {"sweeps", log.sweeps},
          {"points_per_sweep", log.points_per_sweep},
          {"points_dropped", log.points_dropped},
          {"actors", log.actors},
          {"boxes", log.boxes},
          {"boxes_without_points", log.boxes_without_points},
          {"lidar_fit", fits}};
}

std::string alignment_text(const LidarFit& fit) {
  if (fit.points_per_image == 0) return "alignment with the LiDAR unknown: no point projects into the images";
  if (fit.share_worse == 0 && fit.aligned()) return "alignment with the LiDAR unknown: intensities do not help";
  return fmt::format("LiDAR {} with the images (offset {:.0f}, {:.0f} px)", fit.aligned() ? "aligns" : "does not align",
                     fit.offset_x, fit.offset_y);
}

std::string log_text(const LogReport& log) {
  std::string out = fmt::format(
      "log: {} steps, {:.1f} s at {:.1f} Hz; {} sweeps of {:.0f} points\n{} actors with {} boxes, {} of them "
      "without a LiDAR point\n",
      log.steps, log.seconds, log.rate, log.sweeps, log.points_per_sweep, log.actors, log.boxes,
      log.boxes_without_points);
  for (const LidarFit& fit : log.fits) {
    out +=
        fmt::format("{}: {}; {:.0f} LiDAR points per image\n", fit.sensor, alignment_text(fit), fit.points_per_image);
  }
  return out;
}

constexpr double kPoorFit = 4;  // pixels; what COLMAP finds itself is below 2, as a rule

int run_check(const CheckRequest& request, const Common& common) {
  Reading how = request.how;
  how.masks = mask_meaning(request.masks);
  const Scene scene = read_split_scene(request.data, how);
  std::vector<std::string> warnings = scene.warnings;
  for (const auto& more : {check_images(scene, how), check_scene(scene)}) {
    warnings.insert(warnings.end(), more.begin(), more.end());
  }
  LogReport log;
  if (scene.is_log) log = check_log(scene, how.skip_bad);
  warnings.insert(warnings.end(), log.warnings.begin(), log.warnings.end());
  const bool colmap = scene.format == "COLMAP";
  ColmapFit fit;
  if (colmap) fit = check_colmap(scene.root);
  if (fit.mean_error > kPoorFit)
    warnings.push_back(fmt::format(
        "mean reprojection error {:.1f} px: do cameras, images and points come from the same model?", fit.mean_error));
  for (const std::string& warning : warnings) warn(warning);
  const uint64_t bytes = image_bytes(scene, Split::train, how.downscale);
  if (common.json) {
    nlohmann::ordered_json json = {{"schema_version", 1},
                                   {"format", scene.format},
                                   {"images_listed", scene.frames_listed},
                                   {"images", scene.frames.size()},
                                   {"images_train", frames_of(scene, Split::train).size()},
                                   {"images_test", frames_of(scene, Split::test).size()},
                                   {"cameras", scene.cameras.size()},
                                   {"has_alpha", scene.has_alpha},
                                   {"image_bytes", bytes},
                                   {"warnings", warnings}};
    if (scene.is_log) json["log"] = log_json(log);
    if (colmap)
      json["model"] = {
          {"points", fit.points}, {"observations", fit.observations}, {"mean_error_pixels", fit.mean_error}};
    put_json(json, 2);
    return 0;
  }
  std::string out;
  for (const std::string& line : describe(scene, how)) out += line + "\n";
  if (scene.is_log) out += log_text(log);
  if (colmap)
    out += fmt::format("model: {} points, seen {} times in images, mean reprojection error {:.2f} px\n", fit.points,
                       fit.observations, fit.mean_error);
  put(out + "training images in memory: " + words_for_bytes(bytes) + "\n");
  say(common, text("ok. next: cloam train ", scene.is_log ? "genassets " : "nerf ", quoted(request.data),
                   how.allow_outside ? " --allow-outside" : ""));
  return 0;
}

}  // namespace

Command add_check(CLI::App& program) {
  return command<CheckRequest>(program, "check", kCheckExamples, run_check, [](const Options& add, CheckRequest& r) {
    add("DATA", r.data, "Folder of the capture").required();
    add("--downscale", r.how.downscale, "As for train: shrink the images by this factor (1)", whole_number(1, 256));
    add("--holdout", r.how.holdout, "As for train: hold out every Nth image", whole_number(2, 1 << 20));
    add("--masks", r.masks, "As for train: ignore or transparent (ignore)", one_of({"ignore", "transparent"}));
    add("--skip-bad", r.how.skip_bad, "Warn about damaged images instead of stopping");
    add_allow_outside(add, r.how.allow_outside);
  });
}

}  // namespace cloam
