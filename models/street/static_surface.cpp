// See static_surface.h.
#include "models/street/static_surface.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "models/mesh/isosurface.h"

namespace cloam {
namespace {

constexpr double kAround = 2;  // metres

/// Which voxels of a street are occupied; points in its axes.
class OccupiedVoxels {
 public:
  explicit OccupiedVoxels(const StreetSpace& space)
      : numbers_(space.grid().numbers.to_host()), cells_(space.unpacked()) {}

  /// What is not contracted, and a little more, for ground and walls lie at its edge.
  Eigen::AlignedBox3d middle() const {
    const Eigen::Vector3d centre = vector(7), half = vector(10).array() + kAround;
    return {centre - half, centre + half};
  }

  bool none_in(const Eigen::AlignedBox3d& box) const {
    const Eigen::Vector3i low = cell_at(box.min()), high = cell_at(box.max());
    for (int z = low.z(); z <= high.z(); ++z)
      for (int y = low.y(); y <= high.y(); ++y)
        for (int x = low.x(); x <= high.x(); ++x)
          if (is_occupied({x, y, z})) return false;
    return true;
  }

  /// Nothing is where no voxel is occupied.
  void clear_empty(const std::vector<float>& points, std::vector<float>& distances) const {
    for (std::size_t i = 0; i < distances.size(); ++i)
      if (!is_occupied(cell_at({points[3 * i], points[3 * i + 1], points[3 * i + 2]})))
        distances[i] = std::numeric_limits<float>::infinity();
  }

 private:
  Eigen::Vector3d vector(std::size_t first) const {
    return Eigen::Map<const Eigen::Vector3f>(&numbers_[first]).cast<double>();
  }

  Eigen::Vector3i cell_at(const Eigen::Vector3d& point) const {
    return ((point - vector(0)) / static_cast<double>(numbers_[3])).array().floor().cast<int>();
  }

  bool is_occupied(const Eigen::Vector3i& cell) const {
    const std::array<int, 3>& n = cells_.counts;
    for (int axis = 0; axis < 3; ++axis)
      if (cell[axis] < 0 || cell[axis] >= n[static_cast<std::size_t>(axis)]) return false;
    return cells_.cells[(static_cast<std::size_t>(cell.z()) * static_cast<std::size_t>(n[1]) +
                         static_cast<std::size_t>(cell.y())) *
                            static_cast<std::size_t>(n[0]) +
                        static_cast<std::size_t>(cell.x())] != 0;
  }

  std::vector<float> numbers_;  // of StreetGrid
  StreetCells cells_;
};

void move(std::vector<float>& vectors, const Eigen::Matrix3d& turn, const Eigen::Vector3d& shift) {
  for (std::size_t i = 0; i < vectors.size(); i += 3) {
    Eigen::Map<Eigen::Vector3f> at(&vectors[i]);
    at = (turn * at.cast<double>() + shift).cast<float>();
  }
}

}  // namespace

Mesh static_mesh(const StreetSpace& space, const SurfaceSamples& samples, int resolution) {
  const OccupiedVoxels voxels(space);
  Implicit surface;
  surface.values = [&](const std::vector<float>& points) {
    std::vector<float> distances = samples(points, false).distances;
    voxels.clear_empty(points, distances);
    return distances;
  };
  surface.is_empty = [&](const Eigen::AlignedBox3d& box) { return voxels.none_in(box); };
  Mesh mesh = isosurface(grid_over(voxels.middle(), resolution), surface);
  add_colours(
      mesh, [&](const std::vector<float>& points, const std::vector<float>&) { return samples(points, true).colours; });
  const Eigen::Matrix4d world_from_street = space.street_from_world().inverse();
  move(mesh.positions, world_from_street.topLeftCorner<3, 3>(), world_from_street.topRightCorner<3, 1>());
  move(mesh.normals, world_from_street.topLeftCorner<3, 3>(), Eigen::Vector3d::Zero());
  return mesh;
}

}  // namespace cloam
