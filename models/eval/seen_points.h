// What the cameras of the training photos see of a scene, as points on its surfaces.
#pragma once
#include <limits>

#include "models/mesh/mesh.h"
#include "models/runs/listener.h"
#include "models/scene/scene.h"
#include "models/train/renders_views.h"

namespace cloam {

struct SeenPointsWish {
  std::size_t most = 1000000;                                 // points, shared out among the photos
  double farthest = std::numeric_limits<double>::infinity();  // from the camera, in scene units
};

/// Points with normals (towards the camera) and colours, and no triangles, in the world's axes: where a ray of a
/// training photo ends in the mean. Left out are rays that mostly pass through, edges, and actors of a street.
/// index: of the scene among the run's.
Mesh seen_points(RendersViews& method, const Scene& scene, int index, const SeenPointsWish& wish,
                 const Listener& listener);

}  // namespace cloam
