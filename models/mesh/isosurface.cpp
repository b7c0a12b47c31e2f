// Marching tetrahedra: each cell is cut into six tetrahedra along its diagonal, and each of them holds a triangle or a
// quadrangle of the surface. Marching cubes gives half as many triangles, but its table leaves holes where a face has
// opposite corners inside; a tetrahedron has no such case, so the surface is closed without a repair.
// Doi & Koide, An efficient method of triangulating equi-valued surfaces by using tetrahedral cells, 1991.
#include "models/mesh/isosurface.h"

#include <algorithm>
#include <cmath>
#include <limits>
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

constexpr int kBlock = 16;                      // nodes along the sides of what is_empty() is asked of
constexpr std::size_t kPointsAtOnce = 1 << 16;  // so that the memory of whoever answers does not grow with the mesh

/// The values of a few layers of nodes.
class Slab {
 public:
  Slab(const NodeGrid& grid, const Implicit& surface)
      : grid_(grid),
        surface_(surface),
        layer_(std::size_t(grid.counts[0]) * grid.counts[1]),
        values_((kBlock + 1) * layer_) {}

  /// Layers first to first + kBlock. The last ones of the slab before are kept where they are the first of this one.
  void move_to(int first) {
    const bool follows = first > 0 && first == first_ + kBlock;
    if (follows) std::copy_n(values_.begin() + kBlock * layer_, layer_, values_.begin());
    first_ = first;
    const int from = follows ? 1 : 0, until = std::min(kBlock + 1, grid_.counts[2] - first);
    std::fill(values_.begin() + from * layer_, values_.end(), std::numeric_limits<float>::infinity());
    for (int j = 0; j < grid_.counts[1]; j += kBlock)
      for (int i = 0; i < grid_.counts[0]; i += kBlock) list_block({i, j, from}, until);
    ask();
  }

  float at(int i, int j, int k) const { return values_[place(i, j, k - first_)]; }

 private:
  std::size_t place(int i, int j, int k) const { return (std::size_t(k) * grid_.counts[1] + j) * grid_.counts[0] + i; }

  void list_block(const std::array<int, 3>& begin, int until) {
    const int last_i = std::min(begin[0] + kBlock, grid_.counts[0]) - 1,
              last_j = std::min(begin[1] + kBlock, grid_.counts[1]) - 1;
    const auto at = [&](int i, int j, int k) { return grid_.position(i, j, first_ + k); };
    if (surface_.is_empty({at(begin[0], begin[1], begin[2]), at(last_i, last_j, until - 1)})) return;
    for (int k = begin[2]; k < until; ++k)
      for (int j = begin[1]; j <= last_j; ++j)
        for (int i = begin[0]; i <= last_i; ++i) {
          const Eigen::Vector3f point = at(i, j, k).cast<float>();
          points_.insert(points_.end(), point.data(), point.data() + 3);
          places_.push_back(place(i, j, k));
        }
    if (places_.size() >= kPointsAtOnce) ask();
  }

  void ask() {
    if (places_.empty()) return;
    const std::vector<float> values = surface_.values(points_);
    if (values.size() != places_.size())
      throw Error(Fault::internal, text(places_.size(), " points of a surface have ", values.size(), " values"));
    for (std::size_t n = 0; n < values.size(); ++n) values_[places_[n]] = values[n];
    places_.clear();
    points_.clear();
  }

  const NodeGrid& grid_;
  const Implicit& surface_;
  std::size_t layer_;
  int first_ = 0;
  std::vector<float> values_, points_;
  std::vector<std::size_t> places_;  // of the points, among the values
};

class Marcher {
 public:
  Marcher(const NodeGrid& grid, const Implicit& surface) : grid_(grid), slab_(grid, surface) {}

  Mesh run() {
    for (int k = 0; k + 1 < grid_.counts[2]; ++k) {
      if (k % kBlock == 0) slab_.move_to(k);
      for (int j = 0; j + 1 < grid_.counts[1]; ++j)
        for (int i = 0; i + 1 < grid_.counts[0]; ++i) march_cell({i, j, k});
      vertices_[0] = std::move(vertices_[1]);
      vertices_[1].clear();
    }
    return std::move(mesh_);
  }

 private:
  using Cell = std::array<int, 3>;  // its first node

  bool is_rim(const Cell& node) const {
    for (std::size_t axis = 0; axis < 3; ++axis)
      if (node[axis] == 0 || node[axis] + 1 >= grid_.counts[axis]) return true;
    return false;
  }

  static Cell corner(const Cell& cell, int c) {
    return {cell[0] + (c & 1), cell[1] + (c >> 1 & 1), cell[2] + (c >> 2)};
  }

  void march_cell(const Cell& cell) {
    std::array<double, 8> value;
    for (int c = 0; c < 8; ++c) {
      const Cell node = corner(cell, c);
      const double given = slab_.at(node[0], node[1], node[2]);
      const double outside = std::isfinite(given) ? std::abs(given) : grid_.spacing;
      value[std::size_t(c)] = given < 0 && std::isfinite(given) && !is_rim(node) ? given : outside;
    }
    const auto [least, most] = std::minmax_element(value.begin(), value.end());
    if (*least >= 0 || *most < 0) return;
    for (const Tetrahedron& tetrahedron : kTetrahedra) march_tetrahedron(tetrahedron, cell, value);
  }

  void march_tetrahedron(const Tetrahedron& corners, const Cell& cell, const std::array<double, 8>& value) {
    std::array<int, 4> inside{}, outside{};
    std::size_t ins = 0, outs = 0;
    for (int i = 0; i < 4; ++i) (value[std::size_t(corners[std::size_t(i)])] < 0 ? inside[ins++] : outside[outs++]) = i;
    if (ins == 0 || outs == 0) return;
    const auto point = [&](int p, int q) {
      return vertex(cell, corners[std::size_t(p)], corners[std::size_t(q)], value);
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

  // The vertex on the edge between two corners of a cell, made when it is asked for first. Edges are named by their
  // lower node and their direction: the corner numbers of a tetrahedron's edge contain each other as bits.
  std::uint32_t vertex(const Cell& cell, int p, int q, const std::array<double, 8>& value) {
    const int low = p & q, high = p | q;
    const Cell from = corner(cell, low), to = corner(cell, high);
    const std::uint64_t node = std::uint64_t(from[1]) * std::uint64_t(grid_.counts[0]) + std::uint64_t(from[0]);
    auto& known = vertices_[std::size_t(from[2] - cell[2])];
    const auto [place, is_new] =
        known.try_emplace(8 * node + std::uint64_t(high ^ low), static_cast<std::uint32_t>(mesh_.vertex_count()));
    if (!is_new) return place->second;
    const double below = value[std::size_t(low)], above = value[std::size_t(high)];
    const double share = std::clamp(below / (below - above), kFromEnd, 1 - kFromEnd);
    const Eigen::Vector3d a = grid_.position(from[0], from[1], from[2]), b = grid_.position(to[0], to[1], to[2]);
    const Eigen::Vector3d at = a + share * (b - a);
    for (int axis = 0; axis < 3; ++axis) mesh_.positions.push_back(static_cast<float>(at[axis]));
    return place->second;
  }

  const NodeGrid& grid_;
  Slab slab_;
  // By edge, of those whose lower node lies in the layer at hand, and in the next.
  std::array<std::unordered_map<std::uint64_t, std::uint32_t>, 2> vertices_;
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

NodeGrid grid_over(const Eigen::AlignedBox3d& box, int resolution) {
  NodeGrid grid;
  const Eigen::Vector3d size = box.sizes();
  grid.spacing = size.maxCoeff() / resolution;
  for (int axis = 0; axis < 3; ++axis) {
    const int cells = std::max(1, static_cast<int>(std::ceil(size[axis] / grid.spacing - 1e-9)));
    grid.counts[std::size_t(axis)] = cells + 1;
    grid.origin[axis] = box.center()[axis] - 0.5 * grid.spacing * cells;
  }
  return grid;
}

Mesh isosurface(const NodeGrid& grid, const Implicit& surface) {
  Mesh mesh = Marcher(grid, surface).run();
  add_normals(mesh);
  return mesh;
}

void add_colours(Mesh& mesh, const SeenColours& colours) {
  const std::size_t values = mesh.positions.size();
  for (std::size_t first = 0; first < values; first += 3 * kPointsAtOnce) {
    const std::size_t end = std::min(values, first + 3 * kPointsAtOnce);
    const auto part = [&](const std::vector<float>& all) {
      return std::vector<float>(all.data() + first, all.data() + end);
    };
    const std::vector<float> more = colours(part(mesh.positions), part(mesh.normals));
    mesh.colours.insert(mesh.colours.end(), more.begin(), more.end());
  }
}

}  // namespace cloam
