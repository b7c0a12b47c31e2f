// See parts.h.
#include "models/mesh/parts.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <numeric>

namespace cloam {
namespace {

/// Of each vertex: the first vertex of its piece.
class LooseParts {
 public:
  explicit LooseParts(const Mesh& mesh) : parent_(mesh.vertex_count()) {
    std::iota(parent_.begin(), parent_.end(), 0u);
    for (std::size_t t = 0; t < mesh.triangles.size(); t += 3)
      for (std::size_t i = 1; i < 3; ++i) join(mesh.triangles[t], mesh.triangles[t + i]);
  }

  std::uint32_t of(std::uint32_t vertex) {
    while (parent_[vertex] != vertex) vertex = parent_[vertex] = parent_[parent_[vertex]];
    return vertex;
  }

 private:
  void join(std::uint32_t a, std::uint32_t b) {
    a = of(a), b = of(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

  std::vector<std::uint32_t> parent_;
};

double area(const Mesh& mesh, std::size_t first_corner) {
  const auto at = [&](std::size_t i) {
    return Eigen::Map<const Eigen::Vector3f>(&mesh.positions[3 * std::size_t(mesh.triangles[first_corner + i])])
        .cast<double>()
        .eval();
  };
  return 0.5 * (at(1) - at(0)).cross(at(2) - at(0)).norm();
}

void keep_vertices(Mesh& mesh, const std::vector<bool>& kept) {
  std::vector<std::uint32_t> place(kept.size());
  std::uint32_t count = 0;
  for (std::size_t v = 0; v < kept.size(); ++v) {
    if (!kept[v]) continue;
    for (std::vector<float>* values : {&mesh.positions, &mesh.normals, &mesh.colours})
      if (!values->empty()) std::copy_n(values->begin() + 3 * v, 3, values->begin() + 3 * std::size_t(count));
    place[v] = count++;
  }
  for (std::vector<float>* values : {&mesh.positions, &mesh.normals, &mesh.colours})
    if (!values->empty()) values->resize(3 * std::size_t(count));
  std::vector<std::uint32_t> triangles;
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3)
    if (kept[mesh.triangles[t]])
      for (std::size_t i = 0; i < 3; ++i) triangles.push_back(place[mesh.triangles[t + i]]);
  mesh.triangles = std::move(triangles);
}

}  // namespace

std::size_t drop_small_parts(Mesh& mesh, double least_share) {
  if (least_share <= 0 || mesh.triangles.empty()) return 0;
  LooseParts parts(mesh);
  std::vector<double> areas(mesh.vertex_count());  // of a piece, at its first vertex
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3) areas[parts.of(mesh.triangles[t])] += area(mesh, t);
  const double all = std::accumulate(areas.begin(), areas.end(), 0.0),
               least = std::min(least_share * all, *std::max_element(areas.begin(), areas.end()));
  std::vector<bool> kept(mesh.vertex_count());
  std::size_t dropped = 0;
  for (std::uint32_t v = 0; v < kept.size(); ++v) {
    kept[v] = areas[parts.of(v)] >= least;
    dropped += parts.of(v) == v && !kept[v];
  }
  keep_vertices(mesh, kept);
  return dropped;
}

}  // namespace cloam
