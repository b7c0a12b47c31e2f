// Capability: a street whose background and actors are 3D gaussians, each of its own.
#pragma once
#include "models/gaussians/gaussians.h"
#include "models/scene/scene.h"

namespace cloam {

class ExportsActors {
 public:
  virtual ~ExportsActors() = default;
  /// In the log's world.
  virtual Gaussians background_gaussians() const = 0;
  /// In the axes of the actor's box (x right, y forward, z up, metres), as it looks in the middle of its time. None
  /// where it has none.
  virtual Gaussians actor_gaussians(const AssetName& asset) const = 0;
};

}  // namespace cloam
