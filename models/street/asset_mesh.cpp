// See asset_mesh.h.
#include "models/street/asset_mesh.h"

#include "models/mesh/isosurface.h"

namespace cloam {

Mesh asset_mesh(HasSurfaces& street, const AssetName& asset, const Eigen::Vector3d& size, int resolution) {
  constexpr double kMargin = 1.1;
  const Eigen::Vector3d half = 0.5 * kMargin * size;
  const auto distances = [&](const std::vector<float>& points) { return street.sample_asset(asset, points).distances; };
  Mesh mesh = isosurface(grid_over({-half, half}, resolution), {distances});
  add_colours(mesh, [&](const std::vector<float>& points, const std::vector<float>&) {
    return street.sample_asset(asset, points).colours;
  });
  return mesh;
}

}  // namespace cloam
