// cloam check: is this folder a capture that can be trained? Every image is read, none is kept.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "models/data/check_log.h"
#include "models/data/colmap.h"
#include "models/data/read_scene.h"
#include "models/io/in_parallel.h"
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

/// One image a core in memory at a time. Returns what is odd. Fault::data where training would find nothing to learn.
std::vector<std::string> check_images(const Scene& scene, const Reading& how) {
  const auto none = std::make_shared<HostStore>(0, 0);
  const LoadOptions options{how.downscale, how.skip_bad, how.masks, true};
  std::vector<std::string> warnings;
  for (const Split split : {Split::train, Split::test, Split::unused}) {
    const PhotoStore photos = store_images(RestingScene(scene), split, options, none);
    if (split == Split::train) {
      require_training_photos(scene, photos);
      require_unmasked(scene, photos);
    }
    std::vector<PhotoUse> uses(photos.size());
    in_parallel(photos.size(), [&](std::size_t i) { uses[i] = use_of(*photos[i]); });
    warnings.insert(warnings.end(), photos.listed().warnings.begin(), photos.listed().warnings.end());
    if (photos.planes().depths &&
        std::none_of(uses.begin(), uses.end(), [](const PhotoUse& use) { return use.depths; }))
      warnings.push_back(
          "no pixel of the depth maps has a depth: nothing is learned from them; are they of this capture?");
    const auto blank = std::count_if(uses.begin(), uses.end(), [](const PhotoUse& use) { return !use.pixels; });
    if (blank > 0) warnings.push_back(text(blank, " of ", uses.size(), " images have no pixel that counts"));
  }
  return warnings;
}

nlohmann::ordered_json clock_json(const Scene& scene, const ClockReport& clock) {
  const Recording& known = scene.recording;
  return {{"sweep_seconds", known.sweep_seconds},
          {"sweep_stamp_after_middle", known.sweep_stamp},
          {"image_stamp_after_middle", known.image_stamp},
          {"rolling_shutter_seconds", known.shutter},
          {"cameras_after_sweep", clock.cameras_after},
          {"boxes_after_sweep", {clock.first_box_after, clock.last_box_after}},
          {"lidar_poses_replaced", known.poses_replaced},
          {"second_lidar_points", clock.second_lidar_points},
          {"second_lidar_placed", known.second_lidar.has_value()},
          {"car_points", clock.car_points},
          {"car_rows", clock.car_rows}};
}

std::string in_ms(double seconds) { return fmt::format("{:.0f} ms", 1000 * seconds); }

std::string clock_text(const Scene& scene, const LogReport& log) {
  const Recording& known = scene.recording;
  const ClockReport& clock = log.clock;
  std::string out = "clock: ";
  if (known.sweep_seconds > 0)
    out += fmt::format("a sweep takes {}, its stamp is {} after its middle; boxes are from {} before it to {} after it",
                       in_ms(known.sweep_seconds), in_ms(known.sweep_stamp), in_ms(-clock.first_box_after),
                       in_ms(clock.last_box_after));
  else
    out += "sweeps and boxes as stamped, all of a sweep at once";
  out += fmt::format("\nimages: stamps {} after their middle rows; ", in_ms(known.image_stamp));
  out += known.shutter > 0 ? "rolling shutter of " + in_ms(known.shutter) : "all rows at once";
  for (const auto& [camera, after] : clock.cameras_after)
    out += fmt::format("; {} {} {} the sweeps", camera, in_ms(std::abs(after)), after < 0 ? "before" : "after");
  out += fmt::format("\nLiDAR poses: {} of {} judged wrong{}", known.poses_replaced, log.sweeps,
                     known.poses_replaced > 0 ? "; the front camera's poses and times are used" : "");
  if (clock.second_lidar_points > 0)
    out +=
        fmt::format("\nsecond LiDAR: {} points, {}", clock.second_lidar_points,
                    known.second_lidar ? "seen from its own place" : "seen from a place that the log does not state");
  out += fmt::format("\nthe car itself: {} LiDAR points left out", clock.car_points);
  for (const auto& [camera, share] : clock.car_rows)
    out += fmt::format("; the lowest {:.0f} % of {}", 100 * share, camera);
  return out + "\n";
}

nlohmann::ordered_json log_json(const Scene& scene, const LogReport& log) {
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
          {"clock", clock_json(scene, log.clock)},
          {"lidar_fit", fits}};
}

std::string alignment_text(const LidarFit& fit) {
  if (fit.points_per_image == 0) return "alignment with the LiDAR unknown: no point projects into the images";
  if (fit.share_worse == 0 && fit.aligned()) return "alignment with the LiDAR unknown: intensities do not help";
  return fmt::format("LiDAR {} with the images (offset {:.0f}, {:.0f} px)", fit.aligned() ? "aligns" : "does not align",
                     fit.offset_x, fit.offset_y);
}

std::string log_text(const Scene& scene, const LogReport& log) {
  std::string out = fmt::format(
      "log: {} steps, {:.1f} s at {:.1f} Hz; {} sweeps of {:.0f} points\n{} actors with {} boxes, {} of them "
      "without a LiDAR point\n",
      log.steps, log.seconds, log.rate, log.sweeps, log.points_per_sweep, log.actors, log.boxes,
      log.boxes_without_points);
  out += clock_text(scene, log);
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
    if (scene.is_log) json["log"] = log_json(scene, log);
    if (colmap)
      json["model"] = {
          {"points", fit.points}, {"observations", fit.observations}, {"mean_error_pixels", fit.mean_error}};
    put_json(json, 2);
    return 0;
  }
  std::string out;
  for (const std::string& line : describe(scene, how)) out += line + "\n";
  if (scene.is_log) out += log_text(scene, log);
  if (colmap)
    out += fmt::format("model: {} points, seen {} times in images, mean reprojection error {}\n", fit.points,
                       fit.observations, error_in_words(fit));
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
