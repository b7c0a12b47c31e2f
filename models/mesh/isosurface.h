// The surface where a function of space is zero, from its values on a grid.
#pragma once
#include <Eigen/Geometry>
#include <array>
#include <functional>
#include <vector>

#include "models/mesh/mesh.h"

namespace cloam {

/// counts[0] x counts[1] x counts[2] nodes, the first axis innermost; node (i, j, k) lies at origin + spacing (i, j,
/// k).
struct NodeGrid {
  std::array<int, 3> counts = {0, 0, 0};
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  double spacing = 1;

  std::size_t node_count() const { return std::size_t(counts[0]) * counts[1] * counts[2]; }
  Eigen::Vector3d position(int i, int j, int k) const { return origin + spacing * Eigen::Vector3d(i, j, k); }
};

/// A grid about the middle of a box that covers it, `resolution` cells along its longest side.
NodeGrid grid_over(const Eigen::AlignedBox3d& box, int resolution);

/// What has a surface, asked at many points at once.
struct Implicit {
  /// [N] of points [N,3]: negative inside, linear (about) near the surface.
  std::function<std::vector<float>(const std::vector<float>& points)> values;
  /// Whether it is known that nothing in the box is inside: the values there are not asked for then.
  std::function<bool(const Eigen::AlignedBox3d& box)> is_empty = [](const Eigen::AlignedBox3d&) { return false; };
};

/// Positions, normals and triangles; colours are left to the caller. The mesh is closed, each edge has two triangles
/// and no triangle is degenerate, whatever the values are: the outermost nodes and values that are not finite count as
/// outside. The same values give the same mesh. Memory beside the mesh grows with the grid's area, not with its volume:
/// 1024^3 cells take 70 MB.
Mesh isosurface(const NodeGrid& grid, const Implicit& surface);

/// RGB [N,3] in [0,1] of points [N,3] with normals [N,3].
using SeenColours =
    std::function<std::vector<float>(const std::vector<float>& points, const std::vector<float>& normals)>;

/// Gives a mesh without colours those of its vertices, asked for many at once.
void add_colours(Mesh& mesh, const SeenColours& colours);

}  // namespace cloam
