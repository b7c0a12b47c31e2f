// Rows of what stands somewhere for a moment, and of what is infinitely far.
#include <algorithm>
#include <array>
#include <cmath>

#include "runtime/ops/cube_map.h"
#include "runtime/ops/placing.h"
#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

using UpperRows = std::array<std::array<double, 4>, 3>;

/// Of a pose and a turn about its z axis and a shift along its axes: pose * (shift, turn).
UpperRows moved(const UpperRows& pose, const std::array<double, 3>& shift, double turn) {
  const std::array<std::array<double, 3>, 3> about = {
      {{std::cos(turn), -std::sin(turn), 0}, {std::sin(turn), std::cos(turn), 0}, {0, 0, 1}}};
  UpperRows out{};
  for (size_t i = 0; i < 3; ++i) {
    out[i][3] = pose[i][3];
    for (size_t k = 0; k < 3; ++k) {
      out[i][3] += pose[i][k] * shift[k];
      for (size_t j = 0; j < 3; ++j) out[i][j] += pose[i][k] * about[k][j];
    }
  }
  return out;
}

/// in: poses, shifts, turns, rows, shares, sides, view.
double placed_number(const HostArrays& in, int64_t n, size_t which) {
  UpperRows pose{}, view{};
  std::array<double, 3> shift{};
  double turn = 0;
  for (size_t i = 0; i < 12; ++i) {
    pose[i / 4][i % 4] = in[0][12 * n + static_cast<int64_t>(i)];
    view[i / 4][i % 4] = in[6][static_cast<int64_t>(i)];
  }
  for (int64_t j = 0; j < 2; ++j) {
    const auto row = static_cast<int64_t>(in[3][2 * n + j]);
    for (int64_t k = 0; k < 3; ++k) shift[static_cast<size_t>(k)] += in[4][2 * n + j] * in[1][3 * row + k];
    turn += in[4][2 * n + j] * in[2][row];
  }
  UpperRows there = moved(pose, shift, turn);
  for (auto& row : there) row[0] *= in[5][n];
  double sum = 0;
  if (which < 12) {
    for (size_t k = 0; k < 3; ++k) sum += view[which / 4][k] * there[k][which % 4];
    return sum + (which % 4 == 3 ? view[which / 4][3] : 0);
  }
  for (size_t k = 0; k < 3; ++k) {
    double eye = 0;
    for (size_t i = 0; i < 3; ++i) eye -= view[i][k] * view[i][3];
    sum += there[k][which - 12] * (eye - there[k][3]);
  }
  return sum;
}

using Placer = Tensor (*)(const Standings&, const Tensor&);

OpCase placing(const char* op, Placer place, const char* label) {
  return {
      .op = op,
      .label = label,
      .inputs = {constant(normal({5, 3, 4})), normal({7, 3}), between({7, 1}, -0.5, 0.5), below({5, 2}, 7),
                 constant(between({5, 2}, 0, 1)), constant(given({5}, {1, -1, 1, 1, -1})), constant(normal({3, 4}))},
      .run =
          [place](const Tensors& in) {
            return place({in[0], in[1], in[2], in[3], in[4], in[5]}, in[6]);
          },
      .reference =
          [](const HostArrays& in) {
            return from_index({in[0].dim(0), 15},
                              [&](const Shape& at) { return placed_number(in, at[0], static_cast<size_t>(at[1])); });
          }};
}

using Waver = Tensor (*)(const Tensor&, const Waves&);

OpCase waving(const char* op, Waver add, const char* label) {
  return {.op = op,
          .label = label,
          .inputs = {normal({13, 3}), normal({13, 4, 3}), constant(normal({3, 4})), below({13}, 3)},
          .run =
              [add](const Tensors& in) {
                return add(in[0], {in[1], in[2], in[3]});
              },
          .reference =
              [](const HostArrays& in) {
                return from_index({in[0].dim(0), 3}, [&](const Shape& at) {
                  double sum = in[0].at(at);
                  for (int64_t w = 0; w < in[1].dim(1); ++w)
                    sum += in[1].at({at[0], w, at[1]}) * in[2].at({static_cast<int64_t>(in[3][at[0]]), w});
                  return sum;
                });
              }};
}

/// A face's value at a place in [0,1]^2, half-pixel centres, the border going on.
double texel_mix(const HostArray& faces, int64_t face, const std::array<double, 2>& place, int64_t channel) {
  const int64_t side = faces.dim(1);
  std::array<int64_t, 2> low{}, high{};
  std::array<double, 2> part{};
  for (size_t k = 0; k < 2; ++k) {
    const double at = std::clamp(place[k] * static_cast<double>(side) - 0.5, 0.0, static_cast<double>(side - 1));
    low[k] = static_cast<int64_t>(std::floor(at));
    high[k] = std::min(low[k] + 1, side - 1);
    part[k] = at - std::floor(at);
  }
  const auto row = [&](int64_t y) {
    return (1 - part[0]) * faces.at({face, y, low[0], channel}) + part[0] * faces.at({face, y, high[0], channel});
  };
  return (1 - part[1]) * row(low[1]) + part[1] * row(high[1]);
}

/// in: faces, directions, turn.
HostArray cube_reference(const HostArrays& in) {
  return from_index({3, in[1].dim(0)}, [&](const Shape& at) {
    std::array<double, 3> d{};
    for (int64_t i = 0; i < 3; ++i)
      for (int64_t k = 0; k < 3; ++k) d[static_cast<size_t>(i)] += in[2].at({i, k}) * in[1].at({at[1], k});
    size_t axis = 0;
    for (size_t k = 1; k < 3; ++k)
      if (std::abs(d[k]) > std::abs(d[axis])) axis = k;
    const auto place = [&](size_t other) { return 0.5 + 0.5 * d[other] / std::abs(d[axis]); };
    const auto face = static_cast<int64_t>(2 * axis + (d[axis] < 0 ? 1 : 0));
    return texel_mix(in[0], face, {place(axis == 0 ? 1 : 0), place(axis == 2 ? 1 : 2)}, at[0]);
  });
}

using Reader = Tensor (*)(const Tensor&, const Tensor&);

/// Several chunks and bands of texels for the larger ones.
OpCase far_colours(const char* op, Reader read, const char* label, int64_t side, int64_t count) {
  return {.op = op,
          .label = label,
          .inputs = {normal({6, side, side, 3}), constant(normal({count, 3})),
                     constant(given({3, 3}, {0.8, -0.36, 0.48, 0.6, 0.48, -0.64, 0, 0.8, 0.6}))},
          .run = [read, side](const Tensors& in) { return read(in[0], cube_taps(in[1], in[2], side)); },
          .reference = cube_reference};
}

OpCase twice(OpCase row) {
  row.label = "second order";
  row.second_order = true;
  return row;
}

/// Of a linear op the square, which has a second derivative.
OpCase squared(OpCase row) {
  row.run = [run = row.run](const Tensors& in) { return square(run(in)); };
  row.reference = [of = row.reference](const HostArrays& in) {
    const HostArray linear = of(in);
    return from_index(linear.shape, [&](const Shape& at) { return linear.at(at) * linear.at(at); });
  };
  return twice(row);
}

}  // namespace

void add_placing_cases(OpCases& rows) {
  rows.push_back(placing("place_things", place_things, ""));
  rows.push_back(twice(placing("place_things", place_things, "")));
  rows.push_back(placing("place_things_composed", place_things_composed, ""));
  rows.push_back(waving("add_waves", add_waves, ""));
  rows.push_back(squared(waving("add_waves", add_waves, "")));
  rows.push_back(waving("add_waves_composed", add_waves_composed, ""));
  rows.push_back(far_colours("cube_colours", cube_colours, "", 7, 41));
  rows.push_back(far_colours("cube_colours", cube_colours, "bands and chunks", 11, 2300));
  rows.push_back(far_colours("cube_colours", cube_colours, "a texel a face", 1, 17));
  rows.push_back(squared(far_colours("cube_colours", cube_colours, "", 3, 9)));
  rows.push_back(far_colours("cube_colours_composed", cube_colours_composed, "", 7, 41));
  rows.push_back(far_colours("cube_taps", cube_colours, "", 5, 29));
}

}  // namespace cloam
