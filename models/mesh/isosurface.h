// The surface where a signed distance is zero, from its values on a grid.
#pragma once
#include <Eigen/Core>
#include <array>

#include "models/mesh/mesh.h"

namespace cloam {

/// counts[0] x counts[1] x counts[2] nodes, the first axis innermost; node (i, j, k) lies at origin + spacing (i, j,
/// k).
struct DistanceGrid {
  std::array<int, 3> counts = {0, 0, 0};
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  double spacing = 1;
  std::vector<float> distances;  // one a node, negative inside

  std::size_t node_count() const { return std::size_t(counts[0]) * counts[1] * counts[2]; }
  Eigen::Vector3d position(std::size_t node) const;
};

/// A grid about the origin that covers a box of that size and a tenth more, `resolution` cells along its longest side.
/// The distances are left to the caller.
DistanceGrid grid_over(const Eigen::Vector3d& size, int resolution);

/// Positions, normals and triangles; colours are left to the caller. The mesh is closed, each edge has two triangles
/// and no triangle is degenerate, whatever the values are: the outermost nodes and values that are not finite count as
/// outside. The same grid gives the same mesh.
Mesh isosurface(const DistanceGrid& grid);

}  // namespace cloam
