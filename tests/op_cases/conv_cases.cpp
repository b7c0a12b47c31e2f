// Rows of convolutions, their adjoints, and pooling.
#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

/// Calls visit(x index, w index, y index) for every product in a convolution.
template <class Visit>
void each_product(const Shape& x, const Shape& w, const Shape& y, const Conv2dParams& with, Visit visit) {
  each_index(y, [&](const Shape& o) {
    const int64_t group = o[1] / (w[0] / with.groups);
    for (int64_t c = 0; c < w[1]; c++)
      for (int64_t r = 0; r < w[2]; r++)
        for (int64_t s = 0; s < w[3]; s++) {
          const int64_t row = o[2] * with.stride + r - with.pad, column = o[3] * with.stride + s - with.pad;
          if (row < 0 || row >= x[2] || column < 0 || column >= x[3]) continue;
          visit(Shape{o[0], group * w[1] + c, row, column}, Shape{o[1], c, r, s}, o);
        }
  });
}

struct Convolution {
  const char* label;
  Shape x, w;
  Conv2dParams with;
  Shape y() const {
    const auto places = [&](int64_t size, int64_t taps) { return (size + 2 * with.pad - taps) / with.stride + 1; };
    return {x[0], w[0], places(x[2], w[2]), places(x[3], w[3])};
  }
};

OpCase convolving(const Convolution& c) {
  return {.op = "conv2d",
          .label = c.label,
          .inputs = {normal(c.x), normal(c.w)},
          .run = [c](const Tensors& in) { return conv2d(in[0], in[1], c.with); },
          .reference =
              [c](const HostArrays& in) {
                const Shape y{in[0].dim(0), c.y()[1], c.y()[2], c.y()[3]};
                HostArray out(y);
                each_product(in[0].shape, c.w, y, c.with, [&](const Shape& x, const Shape& w, const Shape& o) {
                  out.at(o) += in[0].at(x) * in[1].at(w);
                });
                return out;
              }};
}

/// The image in half precision. Products and sums are those of floats, so the bounds are, too.
OpCase of_halves(OpCase row) {
  row.label += ", halves";
  row.inputs[0] = halves(row.inputs[0].shape);
  return row;
}

OpCase adjoint_x(const Convolution& c) {
  return {.op = "conv2d_dx",
          .label = c.label,
          .inputs = {normal(c.y()), normal(c.w)},
          .run = [c](const Tensors& in) { return conv2d_dx(in[0], in[1], c.x, c.with); },
          .reference =
              [c](const HostArrays& in) {
                HostArray out(c.x);
                each_product(c.x, c.w, c.y(), c.with, [&](const Shape& x, const Shape& w, const Shape& o) {
                  out.at(x) += in[0].at(o) * in[1].at(w);
                });
                return out;
              }};
}

OpCase adjoint_w(const Convolution& c) {
  return {.op = "conv2d_dw",
          .label = c.label,
          .inputs = {normal(c.x), normal(c.y())},
          .run = [c](const Tensors& in) { return conv2d_dw(in[0], in[1], c.w, c.with); },
          .reference =
              [c](const HostArrays& in) {
                HostArray out(c.w);
                each_product(c.x, c.w, c.y(), c.with, [&](const Shape& x, const Shape& w, const Shape& o) {
                  out.at(w) += in[0].at(x) * in[1].at(o);
                });
                return out;
              }};
}

/// inputs: x, w, then the bias and the residual that the row is said to have.
struct Ending {
  const char* label;
  Shape bias = {};  // [K] or [N,K], or none
  bool residual = false;
  Activation activation = Activation::none;
  bool has_bias() const { return bias.rank() > 0; }
};

OpCase ending(const Convolution& c, const Ending& e) {
  OpCase row = convolving(c);
  row.label = e.label;
  row.composed = true;
  const Reference sums = row.reference;
  if (e.has_bias()) row.inputs.push_back(normal(e.bias));
  if (e.residual) row.inputs.push_back(normal(c.y()));
  row.run = [c, e](const Tensors& in) {
    const Epilogue with{e.has_bias() ? in[2] : Tensor(), e.residual ? in.back() : Tensor(), e.activation};
    return conv2d(in[0], in[1], c.with, with);
  };
  row.reference = [e, sums](const HostArrays& in) {
    HostArray out = sums(in);
    each_index(out.shape, [&](const Shape& i) {
      double& y = out.at(i);
      if (e.has_bias()) y += e.bias.rank() == 1 ? in[2].at({i[1]}) : in[2].at({i[0], i[1]});
      if (e.residual) y += in.back().at(i);
      if (e.activation == Activation::relu) y = std::max(y, 0.0);
      if (e.activation == Activation::silu) y = y / (1 + std::exp(-y));
    });
    return out;
  };
  return row;
}

void add_endings(OpCases& rows) {
  const Convolution small{"", {2, 5, 4, 4}, {18, 5, 3, 3}, {.pad = 1}};
  const Convolution large{"", {2, 3, 6, 35}, {9, 3, 3, 3}, {.pad = 1}};
  const Convolution grouped{"", {1, 4, 7, 20}, {6, 2, 3, 3}, {.stride = 2, .pad = 1, .groups = 2}};
  rows.push_back(ending(small, {"small, bias, residual, ReLU", {18}, true, Activation::relu}));
  rows.push_back(ending(small, {"small, bias of each image, SiLU", {2, 18}, false, Activation::silu}));
  rows.push_back(ending(large, {"large, bias of each image, residual", {2, 9}, true}));
  rows.push_back(ending(large, {"large, ReLU", {}, false, Activation::relu}));
  rows.back().second_order = true;
  rows.push_back(ending(large, {"large, bias, residual, SiLU", {9}, true, Activation::silu}));
  rows.back().second_order = true;
  rows.push_back(ending(grouped, {"groups, bias, ReLU", {6}, false, Activation::relu}));
}

void add_halves(OpCases& rows, const std::vector<Convolution>& all) {
  for (const Convolution& c : all) rows.push_back(of_halves(convolving(c)));
  rows[rows.size() - all.size()].zero = {{0, 3, 7, 5}, all[0].w};
  rows[rows.size() - all.size()].second_order = true;
  rows.push_back(of_halves(adjoint_w(all[1])));
  rows.push_back(of_halves(ending(all[0], {"bias, residual, ReLU", {4}, true, Activation::relu})));
}

struct Pool {
  const char* label;
  InputSpec x;
  Pooling with;
  Shape y;
};

OpCase pooling(const Pool& c) {
  return {.op = "max_pool2d",
          .label = c.label,
          .inputs = {c.x},
          .run = [c](const Tensors& in) { return max_pool2d(in[0], c.with); },
          .reference =
              [c](const HostArrays& in) {
                if (in[0].size() == 0) return HostArray({0, c.y[1], c.y[2], c.y[3]});
                HostArray out(c.y, -std::numeric_limits<double>::infinity());
                each_index(in[0].shape, [&](const Shape& i) {
                  each_index({c.y[2], c.y[3]}, [&](const Shape& o) {
                    const int64_t row = i[2] + c.with.pad - o[0] * c.with.stride,
                                  column = i[3] + c.with.pad - o[1] * c.with.stride;
                    if (row < 0 || row >= c.with.window || column < 0 || column >= c.with.window) return;
                    double& largest = out.at({i[0], i[1], o[0], o[1]});
                    largest = std::max(largest, in[0].at(i));
                  });
                });
                return out;
              }};
}

/// Pooling is linear almost everywhere: only what is done with the values has a second derivative.
OpCase squared(OpCase row) {
  const Reference pooled = row.reference;
  row.second_order = true;
  row.run = [run = row.run](const Tensors& in) { return square(run(in)); };
  row.reference = [pooled](const HostArrays& in) {
    HostArray out = pooled(in);
    for (double& value : out.values) value *= value;
    return out;
  };
  return row;
}

void add_pooling(OpCases& rows) {
  rows.push_back(pooling({"2x2", distinct({2, 3, 6, 9}), {}, {2, 3, 3, 4}}));
  rows.back().zero = {{0, 3, 6, 9}};
  rows.back().bench = {normal({4, 64, 128, 128})};
  rows.push_back(pooling({"3x3, stride 2, cut at the end", distinct({1, 5, 6, 29}), {3, 2, 0, true}, {1, 5, 3, 14}}));
  rows.push_back(squared(pooling({"overlapping, squared", distinct({1, 2, 5, 4}), {3, 1, 1}, {1, 2, 5, 4}})));
  rows.push_back(pooling({"padded", distinct({1, 2, 8, 7}), {3, 2, 1}, {1, 2, 4, 4}}));
  rows.push_back(pooling({"padded, cut", distinct({2, 1, 5, 7}), {2, 3, 1, true}, {2, 1, 2, 3}}));
  rows.push_back(pooling({"every pixel's surroundings", distinct({1, 2, 5, 9}), {3, 1, 1}, {1, 2, 5, 9}}));
  rows.push_back(pooling({"long rows", distinct({1, 1, 4, 150}), {3, 2, 0, true}, {1, 1, 2, 75}}));
}

}  // namespace

void add_conv_cases(OpCases& rows) {
  const std::vector<Convolution> all = {
      {"3x3", {2, 3, 7, 5}, {4, 3, 3, 3}, {.pad = 1}},
      {"stride 2, groups", {2, 4, 7, 9}, {6, 2, 3, 3}, {.stride = 2, .pad = 1, .groups = 2}},
      {"1x1", {2, 5, 3, 7}, {3, 5, 1, 1}, {}},
      {"1x1, stride 2, pad 1", {1, 2, 5, 4}, {7, 2, 1, 1}, {.stride = 2, .pad = 1}},
      {"a channel a group", {2, 5, 6, 39}, {5, 1, 3, 2}, {.groups = 5}},
      {"stride 3", {1, 2, 19, 37}, {3, 2, 5, 3}, {.stride = 3, .pad = 2}},
      {"4x4, stride 2", {1, 3, 10, 36}, {9, 3, 4, 4}, {.stride = 2, .pad = 1}},
      {"long rows", {1, 2, 9, 150}, {17, 2, 3, 3}, {.pad = 1}},
      {"many channels", {1, 70, 5, 9}, {37, 70, 3, 3}, {.pad = 1}},
      {"few filters", {2, 37, 5, 18}, {3, 37, 3, 3}, {.pad = 1}},
      {"few filters, an odd row", {1, 5, 7, 40}, {3, 5, 3, 3}, {.pad = 1}},
      {"few channels", {1, 3, 9, 41}, {10, 3, 3, 3}, {.pad = 1}},
      {"small images", {9, 5, 4, 4}, {35, 5, 3, 3}, {.pad = 1}},
      {"few small images", {2, 5, 8, 8}, {35, 5, 3, 3}, {.pad = 1}},
      {"few small images, a last line of one result", {2, 5, 3, 3}, {35, 5, 3, 3}, {.pad = 1}},
      {"small images, stride 2", {9, 19, 6, 6}, {20, 19, 3, 3}, {.stride = 2, .pad = 1}},
  };
  for (const Convolution& c : all) {
    rows.push_back(convolving(c));
    if (&c == &all[0]) {
      rows.back().second_order = true;
      rows.back().zero = {{0, 3, 7, 5}, c.w};
      rows.back().bench = {normal({4, 32, 64, 64}), normal({32, 32, 3, 3})};
      rows.back().bench_flops = 2.0 * 4 * 32 * 64 * 64 * 32 * 9;
    }
    rows.push_back(adjoint_x(c));
    rows.push_back(adjoint_w(c));
  }
  add_endings(rows);
  add_halves(rows, all);
  add_pooling(rows);
}

}  // namespace cloam
