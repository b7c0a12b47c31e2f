// Rows of Gaussian splatting.
#include <algorithm>
#include <array>
#include <cmath>

#include "runtime/ops/splat.h"
#include "tests/op_cases/cases.h"
#include "tests/op_cases/inputs.h"

namespace cloam {
namespace {

/// Random gaussians over a picture, and a list of them for each tile of 16 x 16.
struct SplatScene {
  int64_t height, width, count;
  double low, high;    // deviations in pixels
  double least, most;  // opacities; above 0.99 alpha is cut
  int64_t longest;     // list of a tile
  int64_t channels = 3;
};

/// What a tile lists: any gaussians, some twice; the second tile none.
std::vector<InputSpec> inputs_of(const SplatScene& scene, const std::string& seed) {
  Numbers numbers(seed);
  const auto between = [&](double low, double high) { return low + (high - low) * numbers.uniform(); };
  std::vector<double> means, conics, ids, offsets = {0};
  for (int64_t i = 0; i < scene.count; i++) {
    means.push_back(between(-4, static_cast<double>(scene.width) + 4));
    means.push_back(between(-4, static_cast<double>(scene.height) + 4));
    const double p = std::pow(between(scene.low, scene.high), -2), q = std::pow(between(scene.low, scene.high), -2),
                 turn = between(0, M_PI), c = std::cos(turn), s = std::sin(turn);
    conics.insert(conics.end(), {p * c * c + q * s * s, (p - q) * c * s, p * s * s + q * c * c});
  }
  const int64_t tiles = (scene.height + 15) / 16 * ((scene.width + 15) / 16);
  for (int64_t tile = 0; tile < tiles; tile++) {
    const int64_t length = tile == 1 ? 0 : tile == 0 ? scene.longest : numbers.below(scene.longest + 1);
    for (int64_t k = 0; k < length; k++) ids.push_back(static_cast<double>(numbers.below(scene.count)));
    offsets.push_back(static_cast<double>(ids.size()));
  }
  const auto n = [](const std::vector<double>& values) { return static_cast<int64_t>(values.size()); };
  return {given({scene.count, 2}, means),
          given({scene.count, 3}, conics),
          cloam::between({scene.count, scene.channels}, 0, 1),
          cloam::between({scene.count}, scene.least, scene.most),
          given({n(ids)}, ids, DType::i32),
          given({n(offsets)}, offsets, DType::i32)};
}

/// Colour and transmittance of one pixel, from the paper's formulas.
void blend(const HostArrays& in, const SplatScene& scene, int64_t x, int64_t y, double* out) {
  const int64_t tile = y / 16 * ((scene.width + 15) / 16) + x / 16, channels = scene.channels;
  for (int64_t c = 0; c < channels; c++) out[c] = 0;
  double& through = out[channels] = 1;
  for (auto k = static_cast<int64_t>(in[5][tile]); k < static_cast<int64_t>(in[5][tile + 1]); k++) {
    const auto i = static_cast<int64_t>(in[4][k]);
    const double dx = in[0].at({i, 0}) - (static_cast<double>(x) + 0.5),
                 dy = in[0].at({i, 1}) - (static_cast<double>(y) + 0.5);
    const double form = in[1].at({i, 0}) * dx * dx + 2 * in[1].at({i, 1}) * dx * dy + in[1].at({i, 2}) * dy * dy;
    const double alpha = std::min(0.99, in[3][i] * std::exp(-0.5 * form));
    if (form < 0 || alpha < 1.0 / 255) continue;
    if (through * (1 - alpha) < 1e-4) break;
    for (int64_t c = 0; c < channels; c++) out[c] += through * alpha * in[2].at({i, c});
    through *= 1 - alpha;
  }
}

using Blender = Blended (*)(const Splats& splats, const SplatTiles& tiles);

OpCase blending(const char* label, const SplatScene& scene, Blender blender = splat_blend) {
  return {.op = blender == splat_blend ? "splat_blend" : "splat_blend_composed",
          .label = label,
          .inputs = inputs_of(scene, label),
          .run =
              [scene, blender](const Tensors& in) {
                const Tensor seen = concat({in[0], in[1], unsqueeze(in[3], 1), ones({scene.count, 1})}, 1);
                const SplatTiles tiles = splat_lists(in[4], in[5], {scene.count, scene.height, scene.width});
                const Blended out = blender({seen, in[2]}, tiles);
                return concat({out.image, unsqueeze(out.transmittance, -1)}, 2);
              },
          .reference =
              [scene](const HostArrays& in) {
                HostArray out({scene.height, scene.width, scene.channels + 1});
                for (int64_t y = 0; y < scene.height; y++)
                  for (int64_t x = 0; x < scene.width; x++) blend(in, scene, x, y, &out.at({y, x, 0}));
                return out;
              }};
}

using Vector = std::array<double, 3>;
using Matrix = std::array<Vector, 3>;

/// A camera that sees some gaussians at its edges, where slopes are held, and has some behind.
SplatCamera lens(bool antialiased) {
  return {.fx = 31, .fy = 29, .cx = 20.5f, .cy = 14, .height = 31, .width = 43, .antialiased = antialiased};
}

/// A rotation about an odd axis and a step back.
std::vector<double> view_of_cases() { return {0.96, 0.14, -0.24, 0.1, -0.11, 0.985, 0.13, -0.2, 0.255, -0.1, 0.96, 4}; }

Matrix rotation_of(const HostArray& rotations, int64_t i) {
  double q[4], length = 0;
  for (int64_t k = 0; k < 4; k++) length += rotations.at({i, k}) * rotations.at({i, k});
  for (int64_t k = 0; k < 4; k++) q[k] = rotations.at({i, k}) / std::sqrt(length);
  // v -> v + 2 w (u x v) + 2 u x (u x v), a column for each axis
  Matrix columns;
  for (size_t axis = 0; axis < 3; axis++) {
    const Vector u = {q[1], q[2], q[3]};
    const auto cross = [](const Vector& a, const Vector& b) {
      return Vector{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    };
    Vector v = {0, 0, 0};
    v[axis] = 1;
    const Vector once = cross(u, v), twice = cross(u, once);
    for (size_t k = 0; k < 3; k++) columns[k][axis] = v[k] + 2 * q[0] * once[k] + 2 * twice[k];
  }
  return columns;
}

/// One gaussian's row, from the papers' formulas: cov = J W Sigma W' J' + 0.3 I with Sigma = R S S R'.
void project_one(const HostArrays& in, const SplatCamera& camera, int64_t i, double* out) {
  Vector t;
  const int64_t owner = in.size() > 5 ? static_cast<int64_t>(in[5][i]) : 0;
  const auto view = [&](size_t row, size_t column) {
    return in[4][12 * owner + static_cast<int64_t>(4 * row + column)];
  };
  for (size_t k = 0; k < 3; k++) {
    t[k] = view(k, 3);
    for (size_t j = 0; j < 3; j++) t[k] += view(k, j) * in[0].at({i, static_cast<int64_t>(j)});
  }
  out[0] = out[1] = out[3] = out[5] = out[6] = 0;
  out[2] = out[4] = 1;
  if (t[2] <= double{camera.near}) return;
  const Matrix r = rotation_of(in[2], i);
  Matrix sigma{}, turned{}, cov{};
  for (size_t a = 0; a < 3; a++)
    for (size_t b = 0; b < 3; b++)
      for (size_t k = 0; k < 3; k++)
        sigma[a][b] += r[a][k] * r[b][k] * std::exp(2 * in[1].at({i, static_cast<int64_t>(k)}));
  for (size_t a = 0; a < 3; a++)
    for (size_t b = 0; b < 3; b++)
      for (size_t k = 0; k < 3; k++)
        for (size_t l = 0; l < 3; l++) turned[a][b] += view(a, k) * sigma[k][l] * view(b, l);
  const double f[2] = {double{camera.fx}, double{camera.fy}}, c[2] = {double{camera.cx}, double{camera.cy}};
  const double size[2] = {static_cast<double>(camera.width), static_cast<double>(camera.height)};
  double j[2][3] = {};
  for (size_t a = 0; a < 2; a++) {
    const double more = 0.3 * 0.5 * size[a] / f[a];
    j[a][a] = f[a] / t[2];
    j[a][2] = -f[a] / t[2] * std::clamp(t[a] / t[2], -c[a] / f[a] - more, (size[a] - c[a]) / f[a] + more);
    out[a] = f[a] * t[a] / t[2] + c[a];
  }
  for (size_t a = 0; a < 2; a++)
    for (size_t b = 0; b < 2; b++)
      for (size_t k = 0; k < 3; k++)
        for (size_t l = 0; l < 3; l++) cov[a][b] += j[a][k] * turned[k][l] * j[b][l];
  const double sharp = cov[0][0] * cov[1][1] - cov[0][1] * cov[0][1];
  const double xx = cov[0][0] + double{camera.blur}, yy = cov[1][1] + double{camera.blur};
  const double det = xx * yy - cov[0][1] * cov[0][1];
  out[2] = yy / det;
  out[3] = -cov[0][1] / det;
  out[4] = xx / det;
  out[5] = 1 / (1 + std::exp(-in[3][i])) * (camera.antialiased ? std::sqrt(sharp / det) : 1);
  out[6] = t[2];
}

OpCase projection(const char* label, bool antialiased) {
  const SplatCamera camera = lens(antialiased);
  return {.op = "splat_project",
          .label = label,
          .inputs = {between({23, 3}, -3, 3), between({23, 3}, -2.5, 0), normal({23, 4}), normal({23}),
                     given({3, 4}, view_of_cases())},
          .run =
              [camera](const Tensors& in) {
                return splat_project({in[0], in[1], in[2], in[3]}, in[4], camera);
              },
          .reference =
              [camera](const HostArrays& in) {
                HostArray out({in[0].dim(0), 7});
                for (int64_t i = 0; i < in[0].dim(0); i++) project_one(in, camera, i, &out.at({i, 0}));
                return out;
              }};
}

/// Y_lm by associated Legendre polynomials and cosines of the azimuth, without the Condon-Shortley phase, in the order
/// and with the signs of 3DGS: m from -l to l, (-1)^m.
double harmonic(int l, int m, const Vector& d) {
  const int order = std::abs(m);
  const double azimuth = std::atan2(d[1], d[0]);
  double factorials = 1;
  for (int k = l - order + 1; k <= l + order; k++) factorials *= k;
  const double norm = std::sqrt((2 * l + 1) / (4 * M_PI) / factorials) * std::assoc_legendre(l, order, d[2]);
  const double sign = order % 2 == 0 ? 1 : -1;
  return m == 0 ? norm : sign * std::sqrt(2.0) * norm * (m > 0 ? std::cos(order * azimuth) : std::sin(order * azimuth));
}

/// Each gaussian is one of three things, seen from elsewhere.
OpCase projection_of_things(const char* label, int64_t count, double reach, bool composed = false) {
  OpCase row = projection(label, true);
  const std::vector<double> one = view_of_cases();
  std::vector<double> views = one;
  views.insert(views.end(), {1, 0, 0, 0.3, 0, 0, -1, 0.2, 0, 1, 0, 4});             // turned about x
  views.insert(views.end(), {0.8, 0, -0.6, -0.4, 0, 1, 0, 0.1, 0.6, 0, 0.8, 4.5});  // turned about y
  row.inputs = {between({count, 3}, -reach, reach),
                between({count, 3}, -2.5, 0),
                normal({count, 4}),
                normal({count}),
                given({3, 3, 4}, views),
                below({count}, 3)};
  row.run = [composed](const Tensors& in) {
    return (composed ? splat_project_composed : splat_project)({in[0], in[1], in[2], in[3]}, in[4], lens(true), in[5]);
  };
  if (composed) row.op = "splat_project_composed";
  return row;
}

OpCase colouring(const char* label, int degree) {
  return {.op = "splat_colours",
          .label = label,
          .inputs = {normal({11, 3}), normal({11, 15, 3}), normal({11, 3}), given({3}, {2.5, -2, 3})},
          .run =
              [degree](const Tensors& in) {
                return splat_colours({in[0], in[1], degree}, in[2], in[3]);
              },
          .reference =
              [degree](const HostArrays& in) {
                return from_index({in[0].dim(0), 3}, [&](const Shape& at) {
                  Vector d;
                  const int64_t owner = in.size() > 4 ? static_cast<int64_t>(in[4][at[0]]) : 0;
                  for (int64_t k = 0; k < 3; k++)
                    d[static_cast<size_t>(k)] = in[2].at({at[0], k}) - in[3][3 * owner + k];
                  const double length = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
                  for (double& x : d) x /= length;
                  double all = 0.5 + harmonic(0, 0, d) * in[0].at({at[0], at[1]});
                  for (int l = 1; l <= degree; l++)
                    for (int m = -l; m <= l; m++)
                      all += harmonic(l, m, d) * in[1].at({at[0], l * l + l + m - 1, at[1]});
                  return std::max(0.0, all);
                });
              }};
}

OpCase colouring_of_things(const char* label, bool composed = false) {
  OpCase row = colouring(label, 3);
  row.inputs[3] = given({3, 3}, {2.5, -2, 3, -3, 1, 2, 0.5, 4, -2.5});
  row.inputs.push_back(below({11}, 3));
  row.run = [composed](const Tensors& in) {
    return (composed ? splat_colours_composed : splat_colours)({in[0], in[1], 3}, in[2], in[3], in[4]);
  };
  if (composed) row.op = "splat_colours_composed";
  return row;
}

OpCase second_order(OpCase row) {
  row.second_order = true;
  row.gradient_tolerance = 1e-3;
  return row;
}

/// A round gaussian in the middle of 3 x 3 tiles that is seen in all of them: a list of one for each.
OpCase listing() {
  const double precision = 1.0 / (20 * 20);
  return {.op = "splat_tiles",
          .label = "a tile a column and row",
          .inputs = {given({1, 7}, {24, 24, precision, 0, precision, 0.9, 1})},
          .run = [](const Tensors& in) { return splat_tiles(in[0], 48, 48).offsets; },
          .reference = [](const HostArrays&) { return from_index({10}, [](const Shape& i) { return i[0]; }); },
          .result = DType::i32,
          .gradient = false};
}

}  // namespace

void add_splat_cases(OpCases& rows) {
  rows.push_back(listing());
  rows.push_back(blending("cut tiles", {19, 37, 13, 2, 9, 0.05, 0.95, 23}));
  rows.push_back(blending("long lists", {16, 33, 29, 1, 4, 0.05, 0.15, 300}));
  rows.push_back(blending("opaque", {33, 16, 17, 4, 30, 0.5, 1.2, 40}));
  rows.push_back(blending("features", {17, 18, 9, 2, 9, 0.1, 0.8, 9, 5}));
  rows.push_back(blending("", {19, 37, 13, 2, 9, 0.05, 0.95, 23}, splat_blend_composed));
  rows.back().tolerance = 1e-4;  // light left over is a difference of sums over all tiles
  rows.back().gradient_tolerance = 1e-3;
  rows.push_back(second_order(blending("second order", {6, 5, 4, 7, 9, 0.2, 0.6, 4})));  // every alpha above 1/255
  rows.push_back(projection("", false));
  rows.push_back(projection("antialiased", true));
  OpCase near = projection("second order", true);  // all in the picture
  for (size_t i = 0; i < 4; i++) near.inputs[i].shape[0] = 5;
  near.inputs[0] = between({5, 3}, -1, 1);
  rows.push_back(second_order(near));
  OpCase projected = projection("", true);
  projected.op = "splat_project_composed";
  projected.run = [](const Tensors& in) {
    return splat_project_composed({in[0], in[1], in[2], in[3]}, in[4], lens(true));
  };
  rows.push_back(projected);
  rows.push_back(projection_of_things("of things", 23, 3));
  rows.push_back(second_order(projection_of_things("of things, second order", 6, 1)));
  rows.push_back(projection_of_things("of things", 23, 3, true));
  rows.push_back(colouring("", 3));
  rows.push_back(colouring("degree 1", 1));
  rows.push_back(second_order(colouring("second order", 3)));
  OpCase coloured = colouring("", 2);
  coloured.op = "splat_colours_composed";
  coloured.run = [](const Tensors& in) { return splat_colours_composed({in[0], in[1], 2}, in[2], in[3]); };
  rows.push_back(coloured);
  rows.push_back(colouring_of_things("of things"));
  rows.push_back(second_order(colouring_of_things("of things, second order")));
  rows.push_back(colouring_of_things("of things", true));
}

}  // namespace cloam
