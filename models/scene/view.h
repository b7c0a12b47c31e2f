// What a camera is asked to show, and what it shows.
#pragma once
#include <functional>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// Values [H,W,..] in [0,1] for colour; depth in scene units along the ray (0: nothing there).
struct Picture {
  int width = 0, height = 0;
  std::vector<float> rgb, depth, opacity;
  std::vector<int> actors;  // of methods that know actors: 1 + place in Scene::actors of the actor seen, 0: none
};

struct View {
  Camera camera;
  Eigen::Matrix4d world_from_camera;
  int scene = 0;    // of the run's scenes
  double time = 0;  // seconds on that scene's clock; where actors are
  /// Called between two parts of a rendering that takes long; what it throws gives the picture up.
  std::function<void()> between = [] {};
  std::string sensor = {};  // of a log, "front_camera": whose exposure is shown; another or none: the mean
};

/// What a frame shows, with a camera of the size wanted.
inline View view_of(const Frame& frame, const Camera& camera, int scene) {
  return {camera, frame.world_from_camera, scene, frame.timestamp.value_or(0), [] {}, frame.sensor};
}

}  // namespace cloam
