// Capability: the boxes of actors move while it learns.
#pragma once
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

class RefinesBoxes {
 public:
  virtual ~RefinesBoxes() = default;
  /// The actors of a log (its place among the run's) with their boxes as they were learned, in the log's axes; empty
  /// where the settings leave boxes as they are.
  virtual std::vector<Actor> refined_actors(int log) const = 0;
};

}  // namespace cloam
