// What a street is without its actors, asked point by point.
#pragma once
#include <Eigen/Geometry>
#include <functional>

#include "models/mesh/mesh.h"
#include "models/street/has_surfaces.h"
#include "models/street/street_space.h"

namespace cloam {

/// Distances at points [N,3] in the street's axes, and colours if they are wanted, which cost far more.
using SurfaceSamples = std::function<AssetSamples(const std::vector<float>& points, bool coloured)>;

/// The surface of a log's surroundings within 2 m of the box that holds nearly all of the static returns of its LiDARs,
/// the space that is not contracted. Matter is where `samples` has it and a voxel is occupied: rays look nowhere
/// else. In the world's axes, `resolution` cells along the longest side of the box. No triangles where nothing is.
Mesh static_mesh(const StreetSpace& space, const SurfaceSamples& samples, int resolution);

}  // namespace cloam
