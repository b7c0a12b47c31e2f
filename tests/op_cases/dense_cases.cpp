// Rows of matrix products and convolutions.
#include <cmath>

#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

/// The batch of x at `index`, spread where it has size 1.
double batched(const HostArray& x, const Shape& index, int64_t row, int64_t column) {
  Shape at = x.shape;
  const int batch = x.shape.rank() - 2, lead = index.rank() - x.shape.rank();
  for (int i = 0; i < batch; i++) at[i] = x.shape[i] == 1 ? 0 : index[lead + i];
  at[batch] = row;
  at[batch + 1] = column;
  return x.at(at);
}

HostArray product(const HostArrays& in) {
  const HostArray &a = in[0], &b = in[1];
  Shape front_a, front_b;
  for (int i = 0; i + 2 < a.shape.rank(); i++) front_a.push_back(a.shape[i]);
  for (int i = 0; i + 2 < b.shape.rank(); i++) front_b.push_back(b.shape[i]);
  Shape shape = broadcast("reference", front_a, front_b);
  shape.push_back(a.dim(-2));
  shape.push_back(b.dim(-1));
  return from_index(shape, [&](const Shape& i) {
    double total = 0;
    for (int64_t k = 0; k < a.dim(-1); k++) total += batched(a, i, i[i.rank() - 2], k) * batched(b, i, k, i.back());
    return total;
  });
}

OpCase multiplying(const char* label, const Shape& a, const Shape& b) {
  return {.op = "matmul",
          .label = label,
          .inputs = {normal(a), normal(b)},
          .run = [](const Tensors& in) { return matmul(in[0], in[1]); },
          .reference = product};
}

void add_products(OpCases& rows) {
  rows.push_back(multiplying("small", {7, 5}, {5, 3}));
  rows.back().second_order = true;
  rows.back().zero = {{0, 5}, {5, 3}};
  rows.push_back(multiplying("beyond a tile", {67, 70}, {70, 37}));
  rows.back().bench = {normal({512, 512}), normal({512, 512})};
  rows.back().bench_flops = 2.0 * 512 * 512 * 512;
  rows.push_back(multiplying("long sum", {3, 2503}, {2503, 2}));
  rows.push_back(multiplying("one row", {1, 17}, {17, 19}));
  rows.push_back(multiplying("batch", {3, 7, 5}, {3, 5, 11}));
  rows.back().zero = {{3, 7, 0}, {3, 0, 11}};
  rows.push_back(multiplying("broadcast batch", {2, 1, 5, 7}, {3, 7, 4}));
  rows.push_back(multiplying("one matrix for a batch", {2, 3, 5}, {5, 4}));
  rows.push_back(multiplying("batch of tiny ones", {11, 3, 3}, {11, 3, 1}));
  rows.push_back({.op = "matmul",
                  .label = "by its own transpose",
                  .inputs = {normal({5, 7})},
                  .run = [](const Tensors& in) { return matmul(in[0], transpose(in[0])); },
                  .reference =
                      [](const HostArrays& in) {
                        const HostArray& a = in[0];
                        return from_index({5, 5}, [&](const Shape& i) {
                          double total = 0;
                          for (int64_t k = 0; k < 7; k++) total += a.at({i[0], k}) * a.at({i[1], k});
                          return total;
                        });
                      }});
}

/// inputs: x, w, then the bias and the residual that the row is said to have.
struct Ending {
  const char* label;
  bool bias, residual;
  Activation activation;
};

Epilogue epilogue_of(const Ending& e, const Tensors& in) {
  return {e.bias ? in[2] : Tensor(), e.residual ? in[e.bias ? 3 : 2] : Tensor(), e.activation};
}

HostArray finish(const Ending& e, const HostArrays& in, HostArray sums) {
  for (int64_t i = 0; i < sums.size(); i++) {
    double& y = sums.values[static_cast<size_t>(i)];
    if (e.bias) y += in[2][i % sums.dim(-1)];
    if (e.residual) y += in[e.bias ? 3 : 2][i];
    if (e.activation == Activation::relu) y = std::max(y, 0.0);
    if (e.activation == Activation::silu) y = y / (1 + std::exp(-y));
  }
  return sums;
}

OpCase linear_row(const Ending& e, const Shape& x, const Shape& w) {
  std::vector<InputSpec> inputs = {normal(x), normal(w)};
  if (e.bias) inputs.push_back(normal({w[1]}));
  Shape y = x;
  y[x.rank() - 1] = w[1];
  if (e.residual) inputs.push_back(normal(y));
  return {.op = "linear",
          .label = e.label,
          .inputs = inputs,
          .run = [e](const Tensors& in) { return linear(in[0], in[1], epilogue_of(e, in)); },
          .reference = [e](const HostArrays& in) { return finish(e, in, product(in)); },
          .composed = true};
}

void add_linear(OpCases& rows) {
  rows.push_back(linear_row({"bias", true, false, Activation::none}, {3, 7, 5}, {5, 11}));
  rows.back().zero = {{0, 5}, {5, 3}, {3}};
  rows.push_back(linear_row({"bias and ReLU", true, false, Activation::relu}, {7, 5}, {5, 3}));
  rows.push_back(linear_row({"ReLU", false, false, Activation::relu}, {7, 5}, {5, 3}));
  rows.back().second_order = true;
  rows.push_back(linear_row({"residual", false, true, Activation::none}, {9, 6}, {6, 7}));
  rows.push_back(linear_row({"bias, residual, SiLU", true, true, Activation::silu}, {37, 21}, {21, 67}));
  rows.back().second_order = true;
  rows.push_back(linear_row({"bias, residual, ReLU, long sum", true, true, Activation::relu}, {5, 2503}, {2503, 3}));
}

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

/// The adjoints are reached through the gradient: of x from (y, w), of w from (x, y).
OpCase adjoint_x(const Convolution& c) {
  return {.op = "conv2d_dx",
          .label = c.label,
          .inputs = {normal(c.y()), normal(c.w)},
          .run =
              [c](const Tensors& in) {
                const Tensor x = parameter(std::vector<float>(static_cast<size_t>(numel(c.x))), c.x);
                return grad(sum(conv2d(x, in[1], c.with) * in[0]), {x})[0];
              },
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
          .run =
              [c](const Tensors& in) {
                const Tensor w = parameter(std::vector<float>(static_cast<size_t>(numel(c.w))), c.w);
                return grad(sum(conv2d(in[0], w, c.with) * in[1]), {w})[0];
              },
          .reference =
              [c](const HostArrays& in) {
                HostArray out(c.w);
                each_product(c.x, c.w, c.y(), c.with, [&](const Shape& x, const Shape& w, const Shape& o) {
                  out.at(w) += in[0].at(x) * in[1].at(o);
                });
                return out;
              }};
}

void add_convolutions(OpCases& rows) {
  const Convolution same{"3x3", {2, 3, 7, 5}, {4, 3, 3, 3}, {.pad = 1}};
  const Convolution stepped{"stride 2, groups", {2, 4, 7, 9}, {6, 2, 3, 3}, {.stride = 2, .pad = 1, .groups = 2}};
  const Convolution point{"1x1", {2, 5, 3, 7}, {3, 5, 1, 1}, {}};
  const Convolution deep{"a channel a group", {1, 5, 6, 6}, {5, 1, 3, 2}, {.groups = 5}};
  const Convolution wide{"wide image", {1, 2, 19, 37}, {3, 2, 5, 3}, {.stride = 3, .pad = 2}};
  for (const Convolution& c : {same, stepped, point, deep, wide}) rows.push_back(convolving(c));
  rows[rows.size() - 5].second_order = true;
  rows[rows.size() - 5].zero = {{0, 3, 7, 5}, same.w};
  rows[rows.size() - 5].bench = {normal({4, 32, 64, 64}), normal({32, 32, 3, 3})};
  rows[rows.size() - 5].bench_flops = 2.0 * 4 * 32 * 64 * 64 * 32 * 9;
  for (const Convolution& c : {same, stepped, wide}) {
    rows.push_back(adjoint_x(c));
    rows.push_back(adjoint_w(c));
  }
}

}  // namespace

void add_dense_cases(OpCases& rows) {
  add_products(rows);
  add_linear(rows);
  add_convolutions(rows);
}

}  // namespace cloam
