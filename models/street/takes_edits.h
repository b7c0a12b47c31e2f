// Capability: a built street whose actors are moved and exchanged.
#pragma once
#include "models/scene/scene.h"

namespace cloam {

class TakesEdits {
 public:
  virtual ~TakesEdits() = default;
  /// Actors are where these scenes have them from here on, and wear what they wear there: what a method that is built
  /// from the scenes and restored shows. As many scenes and actors as it was built from, in the same order.
  /// Such a method is not trained any more: it may keep what it makes of parameters.
  virtual void take_actors(const Scenes& scenes) = 0;
};

}  // namespace cloam
