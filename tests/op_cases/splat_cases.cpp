// Rows of splat blending.
#include <cmath>

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
  return {given({scene.count, 2}, means),         given({scene.count, 3}, conics),
          cloam::between({scene.count, 3}, 0, 1), cloam::between({scene.count}, scene.least, scene.most),
          given({n(ids)}, ids, DType::i32),       given({n(offsets)}, offsets, DType::i32)};
}

/// Colour and transmittance of one pixel, from the paper's formulas.
void blend(const HostArrays& in, const SplatScene& scene, int64_t x, int64_t y, double* out) {
  const int64_t tile = y / 16 * ((scene.width + 15) / 16) + x / 16;
  for (int c = 0; c < 3; c++) out[c] = 0;
  out[3] = 1;
  for (auto k = static_cast<int64_t>(in[5][tile]); k < static_cast<int64_t>(in[5][tile + 1]); k++) {
    const auto i = static_cast<int64_t>(in[4][k]);
    const double dx = in[0].at({i, 0}) - (static_cast<double>(x) + 0.5),
                 dy = in[0].at({i, 1}) - (static_cast<double>(y) + 0.5);
    const double form = in[1].at({i, 0}) * dx * dx + 2 * in[1].at({i, 1}) * dx * dy + in[1].at({i, 2}) * dy * dy;
    const double alpha = std::min(0.99, in[3][i] * std::exp(-0.5 * form));
    if (form < 0 || alpha < 1.0 / 255) continue;
    if (out[3] * (1 - alpha) < 1e-4) break;
    for (int64_t c = 0; c < 3; c++) out[c] += out[3] * alpha * in[2].at({i, c});
    out[3] *= 1 - alpha;
  }
}

OpCase blending(const char* label, const SplatScene& scene) {
  return {
      .op = "splat_blend",
      .label = label,
      .inputs = inputs_of(scene, label),
      .run =
          [scene](const Tensors& in) {
            const Blended out = splat_blend({in[0], in[1], in[2], in[3]}, {in[4], in[5], scene.height, scene.width});
            return concat({out.image, unsqueeze(out.transmittance, -1)}, 2);
          },
      .reference =
          [scene](const HostArrays& in) {
            HostArray out({scene.height, scene.width, 4});
            for (int64_t y = 0; y < scene.height; y++)
              for (int64_t x = 0; x < scene.width; x++) blend(in, scene, x, y, &out.at({y, x, 0}));
            return out;
          }};
}

}  // namespace

void add_splat_cases(OpCases& rows) {
  rows.push_back(blending("cut tiles", {19, 37, 13, 2, 9, 0.05, 0.95, 23}));
  rows.push_back(blending("long lists", {16, 33, 29, 1, 4, 0.05, 0.15, 300}));
  rows.push_back(blending("opaque", {33, 16, 17, 4, 30, 0.5, 1.2, 40}));
}

}  // namespace cloam
