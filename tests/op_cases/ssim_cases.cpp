// Rows of the comparison of pictures.
#include <cmath>

#include "runtime/ops/ssim.h"
#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

/// Weights of the window at (dy, dx), which sum to 1.
double window(int64_t dy, int64_t dx) {
  static const double sum = [] {
    double line = 0;
    for (int i = -5; i <= 5; i++) line += std::exp(-i * i / 4.5);
    return line * line;
  }();
  return std::exp(-static_cast<double>(dy * dy + dx * dx) / 4.5) / sum;
}

/// SSIM of one value as the paper has it: 121 places, zero outside the picture.
double similarity(const HostArrays& in, const Shape& at) {
  double x = 0, y = 0, xx = 0, yy = 0, xy = 0;
  for (int64_t r = std::max<int64_t>(at[1] - 5, 0); r <= std::min(at[1] + 5, in[0].dim(1) - 1); r++)
    for (int64_t c = std::max<int64_t>(at[2] - 5, 0); c <= std::min(at[2] + 5, in[0].dim(2) - 1); c++) {
      const double weight = window(r - at[1], c - at[2]), a = in[0].at({at[0], r, c}), b = in[1].at({at[0], r, c});
      x += weight * a, y += weight * b, xx += weight * a * a, yy += weight * b * b, xy += weight * a * b;
    }
  return (2 * x * y + 1e-4) * (2 * (xy - x * y) + 9e-4) / ((x * x + y * y + 1e-4) * (xx - x * x + yy - y * y + 9e-4));
}

/// [2]: the means.
HostArray compared(const HostArrays& in) {
  HostArray out({2});
  each_index(in[0].shape, [&](const Shape& at) {
    out[0] += std::abs(in[0].at(at) - in[1].at(at)) / static_cast<double>(in[0].size());
    out[1] += similarity(in, at) / static_cast<double>(in[0].size());
  });
  return out;
}

Tensor joined(const Likeness& of) { return concat({reshape(of.l1, {1}), reshape(of.ssim, {1})}, 0); }

OpCase comparing(const char* label, const Shape& picture, double low, double high) {
  return {.op = "ssim",
          .label = label,
          .inputs = {between(picture, low, high), constant(between(picture, low, high))},
          .run = [](const Tensors& in) { return joined(likeness(in[0], in[1])); },
          .reference = compared};
}

}  // namespace

void add_ssim_cases(OpCases& rows) {
  rows.push_back(comparing("a pixel", {1, 1, 1}, 0, 1));
  rows.push_back(comparing("smaller than the window", {2, 5, 3}, 0, 1));
  rows.push_back(comparing("a vector", {1, 9, 16}, 0, 1));
  rows.push_back(comparing("cut vectors", {2, 17, 33}, 0, 1));
  rows.push_back(comparing("several tiles", {1, 7, 661}, 0, 1));
  OpCase flat = comparing("bright and flat", {1, 13, 50}, 0.9, 0.95);
  flat.gradient_tolerance = 3e-4;  // variances of 1e-4 out of squares of 1
  rows.push_back(flat);
  OpCase composed = comparing("", {2, 9, 13}, 0, 1);
  composed.op = "ssim_composed";
  composed.run = [](const Tensors& in) { return joined(likeness_composed(in[0], in[1])); };
  composed.gradient_tolerance = 3e-4;
  rows.push_back(composed);
  OpCase again = comparing("second order", {1, 4, 5}, 0, 0.4);
  again.inputs[1] = constant(between({1, 4, 5}, 0.6, 1));  // no value crosses the other picture's
  again.second_order = true;
  again.gradient_tolerance = 1e-3;
  rows.push_back(again);
}

}  // namespace cloam
