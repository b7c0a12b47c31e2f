// The surface of an actor of a trained street.
#pragma once
#include "models/mesh/mesh.h"
#include "models/street/has_surfaces.h"

namespace cloam {

/// The mesh of an asset within a box of `size` (metres, a tenth of margin) in the box's axes, from its distances on a
/// grid of `resolution` cells along the longest side, with the colours that its vertices show outwards. No triangles
/// where it has no surface.
Mesh asset_mesh(HasSurfaces& street, const AssetName& asset, const Eigen::Vector3d& size, int resolution);

}  // namespace cloam
