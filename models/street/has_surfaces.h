// Capabilities: assets, and streets around them, that have a surface.
#pragma once
#include <vector>

#include "models/mesh/mesh.h"
#include "models/scene/scene.h"

namespace cloam {

/// A point cloud's worth of an asset, [N] and [N,3].
struct AssetSamples {
  std::vector<float> distances;  // signed, metres in scale, negative inside
  std::vector<float> colours;    // in [0,1], seen from where the surface faces
};

class HasSurfaces {
 public:
  virtual ~HasSurfaces() = default;
  /// points [N,3] in the axes of the actor's box.
  virtual AssetSamples sample_asset(const AssetName& asset, const std::vector<float>& points) = 0;
};

class HasSurroundings {
 public:
  virtual ~HasSurroundings() = default;
  /// The surface of a log without its actors, in its world's axes (static_mesh).
  virtual Mesh surroundings(int log, int resolution) = 0;
};

}  // namespace cloam
