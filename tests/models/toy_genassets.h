// Small streets of GenAssets, and what tests set in them.
#pragma once
#include <functional>
#include <optional>

#include "models/io/commit.h"
#include "models/io/image.h"
#include "models/train/trainer.h"
#include "tests/models/made_method.h"
#include "tests/models/toy_street.h"

namespace cloam {

inline const Settings kTiny = {
    {"planes.channels", "4"},    {"background.side", "32"},  {"code.side", "4"},         {"code.channels", "4"},
    {"decoder.widths", "8,8"},   {"decoder.middle", "8"},    {"decoder.groups", "4"},    {"field.width", "16"},
    {"image.width", "8"},        {"image.kernel", "3"},      {"image.blocks", "2"},      {"image.upsamplings", "1"},
    {"adversarial.widths", "8"}, {"batch.patches", "2"},     {"batch.patch_side", "12"}, {"batch.lidar_rays", "64"},
    {"steps.actor", "0.1"},      {"weight.perceptual", "0"}, {"weight.adversarial", "0"}};

inline std::unique_ptr<Method> built(const Scene& scene, const Settings& more = {}, const Settings& base = kTiny) {
  Settings all = base;
  all.insert(all.end(), more.begin(), more.end());
  auto method = configured("genassets", all);
  method->build({scene}, 1);
  return method;
}

/// With the photos of all frames, or of one alone.
inline std::unique_ptr<Method> loaded(const Scene& scene, const Settings& more = {}, std::optional<size_t> only = {}) {
  auto method = built(scene, more);
  Pixels pixels = toy_pixels(scene);
  if (only) pixels.frames = {pixels.frames[*only]};
  load_data(*method, scene, std::move(pixels));
  return method;
}

inline std::filesystem::path train_to(Method& method, const std::filesystem::path& folder, int64_t stop_after = 0,
                                      const SafetensorsFile* from = nullptr) {
  TrainOptions options;
  options.steps = 5;
  options.stop_after = stop_after;
  return train({method, folder, {}, from, nullptr}, options, {}).checkpoint;
}

inline void put(Method& method, const std::string& name, const std::vector<float>& values) {
  const Tensor& p = method.parameters().at(name);
  assign({{p, from_host(values, p.shape())}});
}

/// Where distances begin. Matter wherever samples are, if negative: actors fill their boxes, the background its voxels.
inline void fill(Method& method, float distance = -1) {
  std::vector<float> bias = method.parameters().at("networks.field.past.bias").to_host();
  bias[0] = distance;
  put(method, "networks.field.past.bias", bias);
}

/// A car in front of another: at y = 0 the first hides the second from all cameras.
inline Scene crossing(const std::filesystem::path& root, double hidden_y) {
  Scene scene = toy_street(root);
  scene.actors = {toy_actor("front", {2, 3, 6}, 8, 0), toy_actor("hidden", {2, 2, 1.5}, 14, hidden_y)};
  return scene;
}

struct Middle {
  double x = 0, y = 0;
  int pixels = 0;
};

inline Middle middle_of(const Picture& picture, int actor) {
  Middle middle;
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x)
      if (picture.actors[static_cast<size_t>(y * picture.width + x)] == actor)
        middle.x += x + 0.5, middle.y += y + 0.5, middle.pixels++;
  middle.x /= std::max(1, middle.pixels);
  middle.y /= std::max(1, middle.pixels);
  return middle;
}

}  // namespace cloam
