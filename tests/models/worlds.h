// The least data that each kind of method learns from, and the smallest settings of each method.
#pragma once
#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/io/checkpoint.h"
#include "models/metrics/psnr.h"
#include "models/street/street.h"
#include "models/synth/synthetic_scene.h"
#include "models/train/learns_from_run.h"
#include "models/train/trainer.h"
#include "tests/models/made_method.h"
#include "tests/models/toy_street.h"

namespace cloam {

/// What a method can be made small with.
inline Settings small_settings(const std::string& method) {
  if (method == "nerf")
    return {{"field.levels", "3"}, {"field.log2_rows", "8"},  {"field.finest", "16"},    {"field.width", "16"},
            {"batch.rays", "16"},  {"batch.samples", "256"},  {"occupancy.side", "8"},   {"occupancy.cells", "128"},
            {"field.depth", "2"},  {"field.plane_side", "8"}, {"march.min_step", "0.1"}, {"occupancy.start", "1"}};
  if (method == "splat") return {{"initial", "random"}, {"initial.random", "50"}, {"growth.start", "0"}};
  if (method == "genassets")
    return {
        {"planes.channels", "4"},    {"background.side", "16"},  {"code.side", "4"},         {"code.channels", "4"},
        {"decoder.widths", "8,8"},   {"decoder.middle", "8"},    {"decoder.groups", "4"},    {"field.width", "16"},
        {"image.width", "8"},        {"image.kernel", "3"},      {"image.blocks", "1"},      {"image.upsamplings", "1"},
        {"adversarial.widths", "8"}, {"batch.patches", "1"},     {"batch.patch_side", "12"}, {"batch.lidar_rays", "16"},
        {"steps.actor", "0.5"},      {"weight.perceptual", "0"}, {"weight.adversarial", "0"}};
  if (method == "street-gaussians")
    return {{"initial.lidar", "60"},  {"initial.near", "20"}, {"initial.far", "20"}, {"initial.actor", "20"},
            {"initial.fewest", "20"}, {"sky.side", "4"},      {"growth.start", "0"}, {"batch.depth_every", "2"}};
  if (method == "neurad")
    return {{"grid.levels", "2"},       {"grid.log2_rows", "8"},   {"grid.coarsest", "4"},    {"grid.finest", "16"},
            {"actors.levels", "2"},     {"actors.log2_rows", "6"}, {"actors.coarsest", "2"},  {"actors.finest", "4"},
            {"field.width", "16"},      {"field.features", "8"},   {"image.width", "8"},      {"image.kernel", "3"},
            {"image.blocks", "1"},      {"appearance.size", "4"},  {"batch.patches", "3"},    {"batch.patch_side", "6"},
            {"batch.lidar_rays", "16"}, {"steps.actor", "0.5"},    {"weight.perceptual", "0"}};
  if (method == "zipnerf")
    return {{"grid.levels", "3"},       {"grid.log2_rows", "8"},      {"grid.finest", "16"},
            {"field.width", "16"},      {"field.bottleneck", "16"},   {"field.colour_width", "16"},
            {"proposal1.levels", "2"},  {"proposal1.finest", "16"},   {"proposal2.levels", "2"},
            {"proposal2.finest", "16"}, {"proposals.log2_rows", "8"}, {"proposals.width", "16"},
            {"samples.proposal", "6"},  {"samples.field", "4"},       {"batch.rays", "16"}};
  return {{"unet.base", "16"},    {"unet.multipliers", "1,2"}, {"unet.groups", "4"}, {"unet.blocks", "1"},
          {"code.channels", "4"}, {"code.side", "4"},          {"batch.codes", "4"}};
}

/// Photos, a street with two actors, and a run that learned the street.
struct Worlds {
  Folder folder;
  Scene photos, street;
  Pixels photo_pixels, street_pixels;
  Scenes run_scenes;
  LoadedCheckpoint run;
  std::map<std::string, std::string> run_settings;

  Worlds() { make({toy_actor("a", {2, 4, 1.5}, 12, 2), toy_actor("b", {2, 4, 1.5}, 12, -2)}); }
  /// With other actors in the street, or none.
  explicit Worlds(const std::vector<Actor>& actors) { make(actors); }
  const Scene& scene_of(Method& method) const { return as<Street>(method) ? street : photos; }
  const Pixels& pixels_of(Method& method) const { return as<Street>(method) ? street_pixels : photo_pixels; }
  SourceRun source() const {
    return {folder.path / "run",     "genassets",           run_settings, {}, run_scenes,
            parameters_in(run.file), row_steps_in(run.file)};
  }
  /// Of the best colour that knows nothing of places, on the first photo.
  double mean_colour_psnr() const {
    std::vector<float> rgb, mean(3);
    const std::vector<std::uint8_t>& rgba = photo_pixels.frames.front().rgba;
    for (size_t i = 0; i < rgba.size(); ++i)
      if (i % 4 < 3) rgb.push_back(static_cast<float>(rgba[i]) / 255.f);
    for (size_t i = 0; i < rgb.size(); ++i) mean[i % 3] += 3 * rgb[i] / static_cast<float>(rgb.size());
    std::vector<float> flat;
    for (size_t i = 0; i < rgb.size(); ++i) flat.push_back(mean[i % 3]);
    return psnr(flat, rgb);
  }

 private:
  void make(const std::vector<Actor>& actors) {
    write_synthetic_scene(folder.path / "photos", {3, 1, 16, 3});
    photos = read_scene(folder.path / "photos");
    photo_pixels = load_images(photos, Split::train);
    street = toy_street(folder.path);
    street.actors = actors;
    street_pixels = toy_pixels(street);
    if (!actors.empty()) learn_street();
  }

  void learn_street() {
    const auto method = make_method("genassets");
    Config config;
    method->configure(config);
    for (const auto& [key, value] : small_settings("genassets")) config.set(key, value, "test");
    for (const ConfigEntry& entry : config.entries()) run_settings[entry.key] = to_string(entry.value);
    run_scenes = {street};
    method->build(run_scenes, 1);
    load_data(*method, street, street_pixels);
    TrainOptions options;
    options.steps = 4;
    train({*method, folder.path / "run", {}, nullptr, nullptr}, options, {});
    run = load_latest_checkpoint(folder.path / "run");
  }
};

/// Builds a method and gives it what it learns from.
inline void load_world(Method& method, const Worlds& worlds) {
  if (auto* learns = as<LearnsFromRun>(method)) {
    const SourceRun source = worlds.source();
    method.build(worlds.run_scenes, 1);
    learns->load(source);
    return;
  }
  const Scene& scene = worlds.scene_of(method);
  method.build({scene}, 1);
  load_data(method, scene, worlds.pixels_of(method));
}

}  // namespace cloam
