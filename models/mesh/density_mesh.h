// The surface of a radiance field.
#pragma once
#include <Eigen/Geometry>

#include "models/mesh/has_density.h"
#include "models/mesh/mesh.h"

namespace cloam {

struct DensitySurface {
  Eigen::AlignedBox3d bounds;  // world axes; the mesh is closed where it would leave them
  int resolution = 128;        // cells along the longest side
  double level = 1;            // density of the surface, per scene unit
};

/// The density at which half of the light is lost over a 256th of the box's longest side: 59 in NeRF-synthetic's box
/// (NeRF's own meshes have 50). It does not follow the resolution, so that a finer mesh is of the same surface.
double usual_level(const Eigen::AlignedBox3d& bounds);

/// In the world's axes. Between two nodes the logarithm of the density is taken for linear: fields grow exponentially
/// towards a surface. A vertex has the colour that a camera sees which looks at it along the inward normal.
Mesh density_mesh(const DensityField& field, const DensitySurface& surface);

}  // namespace cloam
