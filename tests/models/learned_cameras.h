// What is learned of cameras while the model stands still: photos that show just what the model shows.
#pragma once
#include <algorithm>
#include <cmath>
#include <random>

#include "models/train/optimiser.h"
#include "tests/models/made_method.h"
#include "tests/models/worlds.h"

namespace cloam {

/// Small opaque gaussians of random colours: what tells one camera from another.
inline void make_sharp(Method& splat) {
  std::mt19937 random(6);
  std::uniform_real_distribution<float> colour(-1.5f, 1.5f), place(-0.8f, 0.8f);
  for (const auto& [name, p] : splat.parameters()) {
    std::vector<float> values(static_cast<size_t>(p.numel()), name == "scales" ? std::log(0.05f) : 3.f);
    if (name == "sh_first") std::ranges::generate(values, [&] { return colour(random); });
    if (name == "means") std::ranges::generate(values, [&] { return place(random); });
    if (name == "scales" || name == "opacities" || name == "sh_first" || name == "means") put(splat, name, values);
  }
}

/// Of a small field that is sampled finely enough to tell where a camera or a box is.
inline Settings painted_neurad() {
  Settings settings = small_settings("neurad");
  for (const auto& [key, value] : Settings{{"steps.background", "0.1"},
                                           {"steps.actor", "0.1"},
                                           {"steps.sky", "60"},
                                           {"grid.coarsest", "24"},
                                           {"actors.coarsest", "2"},
                                           {"actors.finest", "4"},
                                           {"grid.finest", "48"},
                                           {"image.upsamplings", "0"},
                                           {"actors.flip", "0"},
                                           {"batch.patches", "4"},
                                           {"batch.patch_side", "24"},
                                           {"batch.lidar_rays", "0"}})
    settings.emplace_back(key, value);
  return settings;
}

/// The same of planes.
inline Settings painted_planes(const Settings& more) {
  Settings settings = small_settings("genassets");
  for (const Settings& all : {Settings{{"decoder.use", "false"},
                                       {"actors.symmetric", "false"},
                                       {"shadows", "false"},
                                       {"steps.background", "0.5"},
                                       {"steps.actor", "0.1"},
                                       {"steps.sky", "4"},
                                       {"image.upsamplings", "0"},
                                       {"batch.patches", "4"},
                                       {"batch.patch_side", "16"},
                                       {"batch.lidar_rays", "0"},
                                       {"background.side", "64"}},
                              more})
    settings.insert(settings.end(), all.begin(), all.end());
  return settings;
}

/// A field of a street that differs from place to place, by waves through its tables or planes.
inline void make_painted(Method& method) {
  for (const auto& [name, p] : method.parameters()) {
    const bool of_places = name.ends_with(".table") || name.ends_with(".planes") || name == "log0.background";
    if (!of_places && !name.ends_with("field.past.bias")) continue;
    std::vector<float> values(static_cast<size_t>(p.numel()));
    for (size_t i = 0; i < values.size(); ++i) values[i] = std::sin(2.3f * static_cast<float>(i));
    if (!of_places) (values = p.to_host())[0] = -0.2f;
    put(method, name, values);
  }
}

/// The photos as `model` shows the frames of its scene, which has one camera.
inline Pixels painted(Pixels photos, Method& model, const Scene& scene) {
  for (FramePixels& photo : photos.frames) {
    const std::vector<float> shows = shown(model, view_of(scene.frames[photo.frame], scene.cameras[0], 0)).rgb;
    for (size_t i = 0; i < photo.rgba.size(); ++i)
      photo.rgba[i] =
          i % 4 == 3 ? 255 : static_cast<uint8_t>(std::lround(255 * std::clamp(shows[i / 4 * 3 + i % 4], 0.f, 1.f)));
  }
  return photos;
}

/// Takes steps of the parameters of one group, all others being those of `model`, which stay.
inline void learn_alone(Method& method, const std::string& prefix, Method& model, int64_t steps) {
  for (const auto& [name, values] : model.parameters())
    if (!name.starts_with(prefix)) assign({{method.parameters().at(name), values}});
  ParameterGroups groups = method.groups();
  for (ParameterGroup& group : groups) group.frozen = group.prefix != prefix;
  Optimiser optimiser(method.parameters(), groups);
  for (int64_t step = 1; step <= steps; ++step) {
    const Progress progress{step, steps, 7, {}};
    const Step taken = method.step(progress, optimiser.wanted(method.parameters()));
    eval(taken.gradients);
    optimiser.step(method.parameters(), taken.gradients, groups, progress);
  }
}

}  // namespace cloam
