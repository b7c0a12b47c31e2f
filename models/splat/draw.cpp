// Projection, tiles and blending, one after another.
#include "models/splat/draw.h"

#include "runtime/ops/splat.h"

namespace cloam {

SplatModel splat_model(const Gaussians& g) {
  const auto count = static_cast<int64_t>(g.count());
  return {{parameter(g.means, {count, 3}), parameter(g.scales, {count, 3}), parameter(g.rotations, {count, 4}),
           parameter(g.opacities, {count})},
          {parameter(g.sh_first, {count, 3}), parameter(g.sh_rest, {count, kSphericalRest, 3}), kSphericalBands}};
}

Tensor view_matrix(const Eigen::Matrix4d& world_from_camera) {
  const Eigen::Matrix3d turned = world_from_camera.block<3, 3>(0, 0).transpose();
  const Eigen::Vector3d away = -turned * world_from_camera.block<3, 1>(0, 3);
  std::vector<float> values;
  for (int row = 0; row < 3; row++) {
    for (int column = 0; column < 3; column++) values.push_back(static_cast<float>(turned(row, column)));
    values.push_back(static_cast<float>(away[row]));
  }
  return from_host(values, {3, 4});
}

Drawn draw(const SplatModel& model, const Camera& camera, const Tensor& view, const DrawOptions& options) {
  SplatCamera lens;
  lens.fx = static_cast<float>(camera.fx), lens.fy = static_cast<float>(camera.fy);
  lens.cx = static_cast<float>(camera.cx), lens.cy = static_cast<float>(camera.cy);
  lens.height = camera.height, lens.width = camera.width;
  lens.near = options.near;
  lens.antialiased = options.antialiased;
  Drawn out;
  out.seen = splat_project(model.cloud, view, lens);
  const Tensor eye = -sum(slice(view, 1, 0, 3) * slice(view, 1, 3, 4), {{0}});  // -R' t
  const Tensor rgb = splat_colours(model.harmonics, model.cloud.means, eye);
  eval_for_gradient({out.seen, rgb});
  out.tiles = splat_tiles(out.seen, camera.height, camera.width);
  const Tensor colours = options.depth ? concat({rgb, slice(out.seen, 1, 6, 7)}, 1) : rgb;
  const Blended blended = splat_blend({out.seen, colours, options.probe}, out.tiles);
  out.planes = permute(blended.image, {2, 0, 1});
  out.transmittance = blended.transmittance;
  return out;
}

}  // namespace cloam
