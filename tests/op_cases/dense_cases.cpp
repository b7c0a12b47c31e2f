// Rows of matrix products.
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

/// Values alone, of operands that lie turned or not: sizes beyond every tile, strip and block, with tails.
OpCase forward(const char* label, const Shape& a, const Shape& b, bool a_turned, bool b_turned) {
  OpCase row = multiplying(label, a, b);
  const auto stored = [](const Shape& shape, bool turned) { return turned ? Shape{shape[1], shape[0]} : shape; };
  row.inputs = {normal(stored(a, a_turned)), normal(stored(b, b_turned))};
  row.run = [=](const Tensors& in) {
    return matmul(a_turned ? transpose(in[0]) : in[0], b_turned ? transpose(in[1]) : in[1]);
  };
  row.reference = [=](const HostArrays& in) {
    const auto turn = [](const HostArray& x) {
      return from_index({x.dim(1), x.dim(0)}, [&](const Shape& i) { return x.at({i[1], i[0]}); });
    };
    return product({a_turned ? turn(in[0]) : in[0], b_turned ? turn(in[1]) : in[1]});
  };
  row.gradient = false;
  return row;
}

void add_large_products(OpCases& rows) {
  rows.push_back(forward("blocks", {131, 601}, {601, 37}, false, false));
  rows.push_back(forward("blocks, A turned", {131, 601}, {601, 37}, true, false));
  rows.push_back(forward("blocks, B turned", {133, 601}, {601, 35}, false, true));
  rows.push_back(forward("blocks, both turned", {37, 601}, {601, 131}, true, true));
  rows.push_back(forward("wide and high", {515, 9}, {9, 517}, false, false));
  rows.push_back(forward("narrow", {300, 70}, {70, 13}, false, true));
  rows.push_back(forward("few rows, split", {7, 5003}, {5003, 30}, true, false));
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
  rows.push_back(multiplying("heads", {2, 3, 19, 8}, {2, 3, 8, 21}));
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
struct RowEnding {
  const char* label;
  bool bias, residual;
  Activation activation;
};

Epilogue epilogue_of(const RowEnding& e, const Tensors& in) {
  return {e.bias ? in[2] : Tensor(), e.residual ? in[e.bias ? 3 : 2] : Tensor(), e.activation};
}

HostArray finish(const RowEnding& e, const HostArrays& in, HostArray sums) {
  for (int64_t i = 0; i < sums.size(); i++) {
    double& y = sums.values[static_cast<size_t>(i)];
    if (e.bias) y += in[2][i % sums.dim(-1)];
    if (e.residual) y += in[e.bias ? 3 : 2][i];
    if (e.activation == Activation::relu) y = std::max(y, 0.0);
    if (e.activation == Activation::silu) y = y / (1 + std::exp(-y));
  }
  return sums;
}

OpCase linear_row(const RowEnding& e, const Shape& x, const Shape& w) {
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

}  // namespace

void add_dense_cases(OpCases& rows) {
  add_products(rows);
  add_large_products(rows);
  add_linear(rows);
}

}  // namespace cloam
