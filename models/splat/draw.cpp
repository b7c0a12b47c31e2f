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

Tensor listed(const SplatTiles& tiles) {
  const int64_t count = tiles.first.dim(0) - 1;
  return slice(tiles.first, 0, 1, count + 1) > slice(tiles.first, 0, 0, count);
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

SplatCamera lens_of(const Camera& camera, const DrawOptions& options) {
  SplatCamera lens;
  lens.fx = static_cast<float>(camera.fx), lens.fy = static_cast<float>(camera.fy);
  lens.cx = static_cast<float>(camera.cx), lens.cy = static_cast<float>(camera.cy);
  lens.height = camera.height, lens.width = camera.width;
  lens.near = options.near;
  lens.antialiased = options.antialiased;
  return lens;
}

MovedViews moved(const Tensor& views, const ViewMove& move) {
  const int64_t count = views.dim(0);
  MovedViews out{views, {}};
  if (move.turned_back) {
    const Tensor shifted = concat({slice(views, 2, 0, 3), slice(views, 2, 3, 4) - move.shift}, 2);
    const Tensor side_by_side = reshape(permute(shifted, {1, 0, 2}), {3, 4 * count});
    out.views = permute(reshape(matmul(move.turned_back, side_by_side), {3, count, 4}), {1, 0, 2});
  }
  out.eyes = -sum(slice(out.views, 2, 0, 3) * slice(out.views, 2, 3, 4), {{1}});  // -R' t
  if (!move.lens.as_given()) out.views = views_through(move.lens, out.views);
  return out;
}

Projection projection_of(const SplatModel& model, const Camera& camera, const Tensor& view,
                         const DrawOptions& options) {
  const auto [views, eyes] = moved(reshape(view, {1, 3, 4}), options.move);
  return {splat_project(model.cloud, reshape(views, {3, 4}), lens_of(camera, options)),
          splat_colours(model.harmonics, model.cloud.means, reshape(eyes, {3}))};
}

Projection together(const Projection& a, const Projection& b) {
  return {concat({a.seen, b.seen}, 0), concat({a.rgb, b.rgb}, 0)};
}

Drawn draw(const Projection& projection, const Camera& camera, const DrawOptions& options) {
  Drawn out;
  out.seen = projection.seen;
  eval_for_gradient({out.seen, projection.rgb});
  out.tiles = splat_tiles(out.seen, camera.height, camera.width);
  Tensors colours = {projection.rgb};
  if (options.depth) colours.push_back(slice(out.seen, 1, 6, 7));
  if (options.more) colours.push_back(options.more);
  const Blended blended =
      splat_blend({out.seen, colours.size() == 1 ? projection.rgb : concat(colours, 1), options.probe}, out.tiles);
  out.planes = permute(blended.image, {2, 0, 1});
  out.transmittance = blended.transmittance;
  return out;
}

Drawn draw(const SplatModel& model, const Camera& camera, const Tensor& view, const DrawOptions& options) {
  return draw(projection_of(model, camera, view, options), camera, options);
}

}  // namespace cloam
