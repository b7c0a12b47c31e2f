// Small streets of GenAssets, and what tests set in them.
#pragma once
#include <optional>

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

/// Where a ray enters and leaves an actor that stands, with the room around its box for mirrors and wheels.
inline std::pair<double, double> within(const Actor& actor, const Eigen::Vector3d& origin, const Eigen::Vector3d& way) {
  const Eigen::Matrix4d box_from_world = actor.boxes[0].world_from_box.inverse();
  const Eigen::Vector3d o = (box_from_world * origin.homogeneous()).head<3>(),
                        d = box_from_world.topLeftCorner<3, 3>() * way,
                        half = actor.size / 2 + Eigen::Vector3d(0.125, 0.125, 0.05);
  const Eigen::Array3d a = (-half - o).array() / d.array(), b = (half - o).array() / d.array();
  return {a.min(b).maxCoeff(), a.max(b).minCoeff()};
}

}  // namespace cloam
