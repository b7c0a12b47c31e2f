// See density_mesh.h.
#include "models/mesh/density_mesh.h"

#include <algorithm>
#include <cmath>

#include "models/mesh/isosurface.h"

namespace cloam {
namespace {

constexpr double kUsualParts = 256;   // of the longest side
constexpr double kLeastShare = 1e-6;  // of the level, for densities of 0
}  // namespace

double usual_level(const Eigen::AlignedBox3d& bounds) { return std::log(2) * kUsualParts / bounds.sizes().maxCoeff(); }

Mesh density_mesh(const DensityField& field, const DensitySurface& surface) {
  const auto values = [&](const std::vector<float>& points) {
    std::vector<float> out = field.densities(points);
    for (float& value : out)
      value = static_cast<float>(-std::log(std::max(static_cast<double>(value) / surface.level, kLeastShare)));
    return out;
  };
  Mesh mesh = isosurface(grid_over(surface.bounds, surface.resolution), {values, field.is_empty});
  add_colours(mesh, [&](const std::vector<float>& points, std::vector<float> directions) {
    for (float& value : directions) value = -value;
    return field.colours(points, directions);
  });
  return mesh;
}

}  // namespace cloam
