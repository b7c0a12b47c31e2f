// Pieces of a mesh that hang together.
#pragma once
#include "models/mesh/mesh.h"

namespace cloam {

/// Removes the connected pieces whose area is less than that share of the whole: floaters, and what is closed inside
/// of a body. How many were removed. At 0 nothing is, and the largest stays at any share.
std::size_t drop_small_parts(Mesh& mesh, double least_share);

}  // namespace cloam
