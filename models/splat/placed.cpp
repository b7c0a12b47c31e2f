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

/// q r = sum over j of (the product of q with these)[j] r_j.
Tensor products_in_products() {
  // Row q_a r_b: which number of the product it is in, and its sign.
  constexpr int kTo[4][4] = {{0, 1, 2, 3}, {1, 0, 3, 2}, {2, 3, 0, 1}, {3, 2, 1, 0}};
  constexpr float kSign[4][4] = {{1, 1, 1, 1}, {1, -1, 1, -1}, {1, -1, -1, 1}, {1, 1, -1, -1}};
  std::vector<float> times(64, 0.f);
  for (size_t a = 0; a < 4; ++a)
    for (size_t b = 0; b < 4; ++b) times[(4 * a + b) * 4 + static_cast<size_t>(kTo[a][b])] = kSign[a][b];
  return from_host(times, {1, 4, 16});
}

/// [N,4,4]: row j is what the number j of r is multiplied with in q r.
Tensor left_products(const Tensor& q) {
  return reshape(sum(unsqueeze(q, 2) * products_in_products(), {{1}}), {q.dim(0), 4, 4});
}

/// Sums over the middle axis of [N,J,K] times [N,J].
Tensor mixed(const Tensor& matrices, const Tensor& with) { return sum(matrices * unsqueeze(with, 2), {{1}}); }

}  // namespace

Tensor axes_of(const Tensor& turns) {
  const int64_t count = turns.dim(0);
  const Tensor products = reshape(unsqueeze(turns, 2) * unsqueeze(turns, 1), {count, 16, 1});
  const Tensor unit = from_host(std::vector<float>{1, 0, 0, 0, 1, 0, 0, 0, 1}, {1, 9});
  return reshape(sum(products * products_in_axes(), {{1}}) + unit, {count, 3, 3});
}

Tensor quaternion_product(const Tensor& q, const Tensor& r) { return mixed(left_products(q), r); }

/// Each thing is its own world: the camera stands in its axes, so that no gaussian is moved.
Projection projection_of(const ThingsModel& things, const Placements& at, const Camera& camera, const Tensor& view,
                         const DrawOptions& options) {
  const auto& [cloud, harmonics] = things.model;
  const Tensor turn = slice(view, 1, 0, 3), away = slice(view, 1, 3, 4);  // camera_from_world
  const Tensor eye = reshape(-sum(turn * away, {{0}}), {1, 3}), axes = axes_of(at.turns);
  const Tensor eyes = sum(axes * unsqueeze(eye - at.positions, 1), {{2}});
  const Tensor turns = sum(unsqueeze(axes, 1) * reshape(turn, {1, 3, 1, 3}), {{3}});
  const Tensor shifts = sum(unsqueeze(at.positions, 1) * unsqueeze(turn, 0), {{2}, true}) + unsqueeze(away, 0);
  Harmonics colours = harmonics;
  if (things.waves)
    colours.first =
        colours.first + reshape(mixed(things.waves, gather_rows(at.waves, things.owners)), harmonics.first.shape());
  return {splat_project(cloud, concat({turns, shifts}, 2), lens_of(camera, options), things.owners),
          splat_colours(colours, cloud.means, eyes, things.owners)};
}

}  // namespace cloam
