// What is learned of cameras while the model stands still: photos that show just what the model shows.
#pragma once
#include <algorithm>
#include <cmath>
#include <random>

#include "models/train/optimiser.h"
#include "tests/models/made_method.h"

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
