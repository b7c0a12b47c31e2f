// See placed.h.
#include "models/splat/placed.h"

namespace cloam {
namespace {

/// Of the 16 products of a quaternion (w, x, y, z) with itself, how many times each is in the columns of its rotation,
/// less the unit matrix: R = 1 + 2 (w [v] + [v][v]) with [v] the matrix of the cross product by v = (x, y, z).
Tensor products_in_axes() {
  std::vector<float> times(16 * 9, 0.f);
  const auto add = [&](int a, int b, int column, int row, float value) {
    times[static_cast<size_t>((4 * a + b) * 9 + 3 * column + row)] += value;
  };
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    for (const int other : {j, k}) {
      add(other + 1, other + 1, i, i, -2);
      add(i + 1, other + 1, i, other, 2);
    }
    add(0, k + 1, i, j, 2);
    add(0, j + 1, i, k, -2);
  }
  return from_host(times, {1, 16, 9});
}

}  // namespace

Tensor axes_of(const Tensor& turns) {
  const int64_t count = turns.dim(0);
  const Tensor products = reshape(unsqueeze(turns, 2) * unsqueeze(turns, 1), {count, 16, 1});
  const Tensor unit = from_host(std::vector<float>{1, 0, 0, 0, 1, 0, 0, 0, 1}, {1, 9});
  return reshape(sum(products * products_in_axes(), {{1}}) + unit, {count, 3, 3});
}

/// Each thing is its own world: the camera stands in its axes, so that no gaussian is moved.
Projection projection_of(const ThingsModel& things, const Placements& at, const Camera& camera, const Tensor& view,
                         const DrawOptions& options) {
  const auto& [cloud, harmonics] = things.model;
  const int64_t count = at.standings.poses.dim(0);
  const Tensor placed = place_things(at.standings, view);
  MovedViews seen{reshape(slice(placed, 1, 0, 12), {count, 3, 4}), slice(placed, 1, 12, 15)};
  if (!options.move.as_given()) seen = moved(seen.views, options.move);
  Harmonics colours = harmonics;
  if (things.waves) colours.first = add_waves(colours.first, {things.waves, at.heights, things.owners});
  return {splat_project(cloud, seen.views, lens_of(camera, options), things.owners),
          splat_colours(colours, cloud.means, seen.eyes, things.owners)};
}

}  // namespace cloam
