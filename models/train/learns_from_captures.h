// Capability: learns from captures and driving logs.
#pragma once
#include <functional>

#include "models/scene/photo_store.h"
#include "models/scene/resting_scene.h"

namespace cloam {

/// One scene of those that build() was given.
struct TrainingData {
  RestingScene scene;
  PhotoStore photos;  // of the training split
};

class LearnsFromCaptures {
 public:
  virtual ~LearnsFromCaptures() = default;
  /// Whether load_data puts all images on the device; false: a step's alone.
  virtual bool images_on_device() const { return true; }
  /// Whether depth maps beside photos are of use as it is configured.
  virtual bool uses_depths() const { return false; }
  /// After build; one entry a scene, in the same order.
  virtual void load_data(std::vector<TrainingData> data) = 0;
  /// Is told how many scenes load_data has done of all, where that may take minutes.
  std::function<void(std::size_t done, std::size_t all)> loaded = [](std::size_t, std::size_t) {};
  /// What the user should know about how it will begin with a scene, a line each. After build.
  virtual std::vector<std::string> warnings(const Scene&) const { return {}; }
};

}  // namespace cloam
