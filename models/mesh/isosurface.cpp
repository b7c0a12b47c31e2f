// Marching tetrahedra: each cell is cut into six tetrahedra along its diagonal, and each of them holds a triangle or a
// quadrangle of the surface. Marching cubes gives half as many triangles, but its table leaves holes where a face has
// opposite corners inside; a tetrahedron has no such case, so the surface is closed without a repair.
// Doi & Koide, An efficient method of triangulating equi-valued surfaces by using tetrahedral cells, 1991.
#include "models/mesh/isosurface.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "runtime/error.h"

namespace cloam {
namespace {

// A vertex keeps this share of its edge from either end, so that no two vertices of a triangle can meet.
constexpr double kFromEnd = 0.01;

// Corner c of a cell lies at (c & 1, c >> 1 & 1, c >> 2 & 1). The tetrahedra go from corner 0 to corner 7 along three
// edges of the cell and are right-handed; neighbouring cells cut their common face along the same diagonal.
using Tetrahedron = std::array<int, 4>;
constexpr Tetrahedron kTetrahedra[] = {{0, 1, 3, 7}, {0, 2, 6, 7}, {0, 4, 5, 7},
                                       {0, 3, 2, 7}, {0, 6, 4, 7}, {0, 5, 1, 7}};

class Marcher {
 public:
  explicit Marcher(const DistanceGrid& grid) : grid_(grid) {
    const std::size_t row = std::size_t(grid.counts[0]);
    for (std::size_t c = 0; c < 8; ++c) offset_[c] = (c & 1) + row * ((c >> 1 & 1) + (c >> 2) * grid.counts[1]);
  }

  Mesh run() {
    std::size_t node = 0;
    for (int k = 0; k < grid_.counts[2]; ++k) {
      for (int j = 0; j < grid_.counts[1]; ++j) {
        for (int i = 0; i < grid_.counts[0]; ++i, ++node) {
          if (is_last(i, 0) || is_last(j, 1) || is_last(k, 2)) continue;
          march_cell({i, j, k}, node);
        }
      }
    }
    return std::move(mesh_);
  }

 private:
  bool is_last(int index, int axis) const { return index + 1 >= grid_.counts[std::size_t(axis)]; }

  bool is_rim(const std::array<int, 3>& cell, int corner) const {
    for (int axis = 0; axis < 3; ++axis) {
      const int index = cell[std::size_t(axis)] + (corner >> axis & 1);
      if (index == 0 || is_last(index, axis)) return true;
    }
    return false;
  }

  void march_cell(const std::array<int, 3>& cell, std::size_t node) {
    std::array<double, 8> value;
    for (int c = 0; c < 8; ++c) {
      const double distance = grid_.distances[node + offset_[std::size_t(c)]];
      const double outside = std::isfinite(distance) ? std::abs(distance) : grid_.spacing;
      value[std::size_t(c)] = distance < 0 && std::isfinite(distance) && !is_rim(cell, c) ? distance : outside;
    }
    const auto [least, most] = std::minmax_element(value.begin(), value.end());
    if (*least >= 0 || *most < 0) return;
    for (const Tetrahedron& tetrahedron : kTetrahedra) march_tetrahedron(tetrahedron, node, value);
  }

  void march_tetrahedron(const Tetrahedron& corners, std::size_t node, const std::array<double, 8>& value) {
    std::array<int, 4> inside{}, outside{};
    std::size_t ins = 0, outs = 0;
    for (int i = 0; i < 4; ++i) (value[std::size_t(corners[std::size_t(i)])] < 0 ? inside[ins++] : outside[outs++]) = i;
    if (ins == 0 || outs == 0) return;
    const auto point = [&](int p, int q) {
      return vertex(node, corners[std::size_t(p)], corners[std::size_t(q)], value);
    };
    if (ins == 2) {
      // (a, b, c, d) is to be an even permutation, which keeps the tetrahedron right-handed.
      const int a = inside[0], b = inside[1];
      const bool even = b - a != 2;
      const int c = outside[even ? 0 : 1], d = outside[even ? 1 : 0];
      const auto ac = point(a, c), ad = point(a, d), bd = point(b, d), bc = point(b, c);
      add(ac, ad, bd);
      add(ac, bd, bc);
      return;
    }
    // The corner that is alone on its side; i ^ alone for i = 0..3 is an even permutation that begins with it.
    const int alone = ins == 1 ? inside[0] : outside[0];
    const auto first = point(alone, 1 ^ alone), second = point(alone, 2 ^ alone), third = point(alone, 3 ^ alone);
    if (ins == 1)
      add(first, second, third);
    else
      add(first, third, second);
  }

  void add(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    mesh_.triangles.insert(mesh_.triangles.end(), {a, b, c});
  }

  // The vertex on the edge between two corners of the cell at `node`, made when it is asked for first. Edges are named
  // by their lower node and their direction: the corner numbers of a tetrahedron's edge contain each other as bits.
  std::uint32_t vertex(std::size_t node, int p, int q, const std::array<double, 8>& value) {
    const int low = p & q, high = p | q;
    const std::uint64_t edge = 8 * (node + offset_[std::size_t(low)]) + std::uint64_t(high ^ low);
    const auto [place, is_new] = vertices_.try_emplace(edge, static_cast<std::uint32_t>(mesh_.vertex_count()));
    if (!is_new) return place->second;
    const double from = value[std::size_t(low)], to = value[std::size_t(high)];
    const double share = std::clamp(from / (from - to), kFromEnd, 1 - kFromEnd);
    const Eigen::Vector3d a = grid_.position(node + offset_[std::size_t(low)]),
                          b = grid_.position(node + offset_[std::size_t(high)]);
    const Eigen::Vector3d at = a + share * (b - a);
    for (int axis = 0; axis < 3; ++axis) mesh_.positions.push_back(static_cast<float>(at[axis]));
    return place->second;
  }

  const DistanceGrid& grid_;
  std::array<std::size_t, 8> offset_;  // of a cell's corners from its first, in nodes
  std::unordered_map<std::uint64_t, std::uint32_t> vertices_;
  Mesh mesh_;
};

Eigen::Vector3d position(const Mesh& mesh, std::uint32_t vertex) {
  return Eigen::Map<const Eigen::Vector3f>(&mesh.positions[3 * std::size_t(vertex)]).cast<double>();
}

/// Normals of the triangles, weighted by area.
void add_normals(Mesh& mesh) {
  std::vector<Eigen::Vector3d> sums(mesh.vertex_count(), Eigen::Vector3d::Zero());
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3) {
    const std::uint32_t* corner = &mesh.triangles[t];
    const Eigen::Vector3d a = position(mesh, corner[0]);
    const Eigen::Vector3d area = (position(mesh, corner[1]) - a).cross(position(mesh, corner[2]) - a);
    for (int i = 0; i < 3; ++i) sums[corner[i]] += area;
  }
  for (const Eigen::Vector3d& sum : sums) {
    const Eigen::Vector3d normal = sum.norm() > 0 ? sum.normalized() : Eigen::Vector3d::UnitZ();
    for (int axis = 0; axis < 3; ++axis) mesh.normals.push_back(static_cast<float>(normal[axis]));
  }
}

}  // namespace

Eigen::Vector3d DistanceGrid::position(std::size_t node) const {
  const std::size_t row = std::size_t(counts[0]), slice = row * std::size_t(counts[1]);
  const Eigen::Vector3d index(double(node % row), double(node / row % std::size_t(counts[1])), double(node / slice));
  return origin + spacing * index;
}

DistanceGrid grid_over(const Eigen::Vector3d& size, int resolution) {
  constexpr double kMargin = 1.1;
  DistanceGrid grid;
  grid.spacing = kMargin * size.maxCoeff() / resolution;
  for (int axis = 0; axis < 3; ++axis) {
    const int cells = std::max(1, static_cast<int>(std::ceil(kMargin * size[axis] / grid.spacing - 1e-9)));
    grid.counts[std::size_t(axis)] = cells + 1;
    grid.origin[axis] = -0.5 * grid.spacing * cells;
  }
  return grid;
}

Mesh isosurface(const DistanceGrid& grid) {
  if (grid.distances.size() != grid.node_count()) {
    throw Error(Fault::internal,
                text("a grid of ", grid.node_count(), " nodes has ", grid.distances.size(), " distances"));
  }
  Mesh mesh = Marcher(grid).run();
  add_normals(mesh);
  return mesh;
}

}  // namespace cloam
