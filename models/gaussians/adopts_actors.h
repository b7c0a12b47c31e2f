// Capability: a street that shows actors with the gaussians of another run.
#pragma once
#include <cstddef>

#include "models/gaussians/gaussians.h"

namespace cloam {

class AdoptsActors {
 public:
  virtual ~AdoptsActors() = default;
  /// The gaussians, in the axes of a box as ExportsActors gives them, are those of an actor from here on, who had none:
  /// the one at that place of the log. They are parameters as those of others.
  virtual void adopt(std::size_t place, const Gaussians& looks) = 0;
};

}  // namespace cloam
