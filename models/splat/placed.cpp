// See placed.h.
#include "models/splat/placed.h"

namespace cloam {
namespace {

Tensor column(const Tensor& x, int64_t i) { return slice(x, 1, i, i + 1); }
Tensor columns(const Tensor& x, int64_t begin) { return slice(x, 1, begin, begin + 3); }

enum Column : int64_t { kAxes = 0, kPosition = 9, kTurn = 12, kEye = 16, kWaves = 19 };

/// All that a gaussian asks of its thing, side by side: [N, 19 + W]. The eye in the thing's axes is R'(eye - position).
Tensor numbers_of(const Placements& at, const Tensor& view) {
  const Tensor eye = reshape(-sum(slice(view, 1, 0, 3) * slice(view, 1, 3, 4), {{0}}), {1, 3});
  const Tensor axes = axes_of(at.turns), way = eye - at.positions;
  Tensors all = {axes, at.positions, at.turns};
  for (int64_t axis = 0; axis < 3; ++axis) all.push_back(sum(columns(axes, 3 * axis) * way, {{1}, true}));
  if (at.waves) all.push_back(at.waves);
  return concat(all, 1);
}

}  // namespace

Tensor axes_of(const Tensor& turns) {
  const Tensor w = column(turns, 0), x = column(turns, 1), y = column(turns, 2), z = column(turns, 3);
  return concat({1.f - 2.f * (y * y + z * z), 2.f * (x * y + w * z), 2.f * (x * z - w * y), 2.f * (x * y - w * z),
                 1.f - 2.f * (x * x + z * z), 2.f * (y * z + w * x), 2.f * (x * z + w * y), 2.f * (y * z - w * x),
                 1.f - 2.f * (x * x + y * y)},
                1);
}

Tensor quaternion_product(const Tensor& q, const Tensor& r) {
  const Tensor w = column(q, 0), x = column(q, 1), y = column(q, 2), z = column(q, 3);
  const Tensor a = column(r, 0), b = column(r, 1), c = column(r, 2), d = column(r, 3);
  return concat({w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c, w * c - x * d + y * a + z * b,
                 w * d + x * c - y * b + z * a},
                1);
}

Projection projection_of(const ThingsModel& things, const Placements& at, const Camera& camera, const Tensor& view,
                         const DrawOptions& options) {
  const auto& [cloud, harmonics] = things.model;
  const Tensor own = gather_rows(numbers_of(at, view), things.owners);
  Tensor means = columns(own, kPosition);
  for (int64_t axis = 0; axis < 3; ++axis) means = means + columns(own, kAxes + 3 * axis) * column(cloud.means, axis);
  Harmonics colours = harmonics;
  for (int64_t wave = 0; things.waves && wave < things.waves.dim(1); ++wave)
    colours.first = colours.first + column(own, kWaves + wave) *
                                        reshape(slice(things.waves, 1, wave, wave + 1), harmonics.first.shape());
  const Cloud placed = {means, cloud.scales, quaternion_product(slice(own, 1, kTurn, kEye), cloud.rotations),
                        cloud.opacities};
  return {splat_project(placed, view, lens_of(camera, options)),
          splat_colours(colours, cloud.means - columns(own, kEye), zeros({3}))};
}

}  // namespace cloam
