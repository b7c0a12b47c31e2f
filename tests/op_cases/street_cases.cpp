// Row of the compositing by opacities.
#include <cmath>

#include "runtime/ops/street.h"
#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

constexpr int64_t kBackground = 6;
constexpr double kNear = 0.5;

/// Inputs alpha, features, t, rows, offsets, ranges. The last sample of a ray takes the light that is left.
HostArray blended(const HostArrays& in) {
  const int64_t rays = in[4].size() - 1, channels = in[1].dim(1);
  HostArray out({rays, channels + 4});
  for (int64_t r = 0; r < rays; r++) {
    const auto first = static_cast<int64_t>(in[4][r]), last = static_cast<int64_t>(in[4][r + 1]);
    double through = 1;
    for (int64_t i = first; i < last; i++) {
      const auto row = static_cast<int64_t>(in[3][i]);
      const double weight = through * (i + 1 == last ? 1 : in[0][row]);
      for (int64_t c = 0; c < channels; c++) out.at({r, c}) += weight * in[1].at({row, c});
      out.at({r, channels}) += weight * std::abs(in[2][i]);
      if (in[2][i] >= 0) out.at({r, channels + 1}) += weight;
      if (in[5][r] > 0 && std::abs(std::abs(in[2][i]) - in[5][r]) > kNear) out.at({r, channels + 2}) += weight * weight;
      if (row >= kBackground) out.at({r, channels + 3}) += weight;
      through *= 1 - in[0][row];
    }
  }
  return out;
}

OpCase blend_row(const char* label, int64_t channels) {
  return {.op = "street_blend",
          .label = label,
          .inputs = {between({11, 1}, 0.05, 0.9), normal({11, channels}), constant(between({11}, -2, 5)),
                     given({11}, {4, 0, 9, 2, 7, 1, 10, 3, 5, 8, 6}, DType::i32),
                     given({5}, {0, 6, 6, 8, 11}, DType::i32), constant(given({4}, {2.5, 1, 0, 3}))},
          .run =
              [](const Tensors& in) {
                return street_blend({reshape(in[0], {in[0].dim(0)}), in[1], in[2], in[3], in[4], in[5], kBackground,
                                     static_cast<float>(kNear)});
              },
          .reference = blended};
}

}  // namespace

void add_street_cases(OpCases& rows) {
  rows.push_back(blend_row("", 5));
  rows.push_back(blend_row("whole vectors", 32));
}

}  // namespace cloam
