// The boxes of actors as rays meet them: padded, in street axes, each with a cube that the planes of its asset fill.
#pragma once
#include "models/batches/log_source.h"
#include "models/street/street_space.h"
#include "runtime/ops/street.h"

namespace cloam {

/// From metres in a box of that size to its cube of side 1.
float cube_scale(const Eigen::Vector3d& size);

/// The boxes of every moment of the rays, of those actors that they may meet (RayList::actors). Owners are places among
/// `actors`.
StreetBoxes boxes_of(const std::vector<Actor>& actors, const RayList& rays, const StreetSpace& space);

/// One box of that size about the origin, whose owner is 0.
StreetBoxes single_box(const Eigen::Vector3d& size);

/// The sky of a grid alone: none of its voxels is met.
StreetGrid sky_of(const StreetGrid& grid);

}  // namespace cloam
