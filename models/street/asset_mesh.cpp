// See asset_mesh.h.
#include "models/street/asset_mesh.h"

#include <algorithm>

#include "models/mesh/isosurface.h"

namespace cloam {
namespace {

constexpr std::size_t kPointsAtOnce = 1 << 16;  // so that the method's memory does not grow with the grid

std::vector<float> node_positions(const DistanceGrid& grid, std::size_t first, std::size_t end) {
  std::vector<float> points;
  for (std::size_t node = first; node < end; ++node) {
    const Eigen::Vector3f point = grid.position(node).cast<float>();
    points.insert(points.end(), point.data(), point.data() + 3);
  }
  return points;
}

void append(std::vector<float>& all, const std::vector<float>& more) {
  all.insert(all.end(), more.begin(), more.end());
}

}  // namespace

Mesh asset_mesh(HasSurfaces& street, const AssetName& asset, const Eigen::Vector3d& size, int resolution) {
  DistanceGrid grid = grid_over(size, resolution);
  const std::size_t nodes = grid.node_count();
  for (std::size_t first = 0; first < nodes; first += kPointsAtOnce) {
    const std::size_t end = std::min(nodes, first + kPointsAtOnce);
    append(grid.distances, street.sample_asset(asset, node_positions(grid, first, end)).distances);
  }
  Mesh mesh = isosurface(grid);
  const std::size_t values = mesh.positions.size();
  for (std::size_t first = 0; first < values; first += 3 * kPointsAtOnce) {
    const float* points = mesh.positions.data();
    const std::size_t end = std::min(values, first + 3 * kPointsAtOnce);
    append(mesh.colours, street.sample_asset(asset, {points + first, points + end}).colours);
  }
  return mesh;
}

}  // namespace cloam
