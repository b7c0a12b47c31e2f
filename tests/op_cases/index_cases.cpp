// Rows of gathers, scatters, sorting, segments and running sums.
#include <algorithm>
#include <numeric>

#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

/// Numbers in a row of a tensor whose rows are its first axis.
int64_t width_of(const HostArray& x) {
  int64_t width = 1;
  for (int i = 1; i < x.shape.rank(); i++) width *= x.shape[i];
  return width;
}

Shape with_rows(Shape shape, int64_t count) {
  shape[0] = count;
  return shape;
}

HostArray gathered(const HostArray& table, const HostArray& rows) {
  Shape shape = rows.shape;
  for (int i = 1; i < table.shape.rank(); i++) shape.push_back(table.shape[i]);
  HostArray out(shape);
  const int64_t width = width_of(table);
  for (int64_t i = 0; i < rows.size(); i++) {
    const int64_t row = std::clamp<int64_t>(static_cast<int64_t>(rows[i]), 0, table.dim(0) - 1);
    for (int64_t k = 0; k < width; k++) out[i * width + k] = table[row * width + k];
  }
  return out;
}

HostArray scattered(const HostArray& values, const HostArray& rows, int64_t count) {
  HostArray out(with_rows(values.shape, count));
  const int64_t width = width_of(values);
  for (int64_t i = 0; i < rows.size(); i++) {
    const int64_t row = std::clamp<int64_t>(static_cast<int64_t>(rows[i]), 0, count - 1);
    for (int64_t k = 0; k < width; k++) out[row * width + k] += values[i * width + k];
  }
  return out;
}

OpCase gathering(const char* label, const InputSpec& table, const InputSpec& rows) {
  return {.op = "gather_rows",
          .label = label,
          .inputs = {table, rows},
          .run = [](const Tensors& in) { return gather_rows(in[0], in[1]); },
          .reference = [](const HostArrays& in) { return gathered(in[0], in[1]); },
          .result = table.dtype};
}

OpCase scattering(const char* label, const Shape& values, int64_t count) {
  return {.op = "scatter_add_rows",
          .label = label,
          .inputs = {normal(values), below({values[0]}, count)},
          .run = [count](const Tensors& in) { return scatter_add_rows(in[0], in[1], count); },
          .reference = [count](const HostArrays& in) { return scattered(in[0], in[1], count); },
          .second_order = false};
}

void add_rows_by_number(OpCases& rows) {
  rows.push_back(gathering("matrix", normal({7, 5}), below({3, 4}, 7)));
  rows.back().zero = {{7, 5}, {0, 4}};
  rows.push_back(gathering("vector", normal({11}), below({13}, 11)));
  rows.push_back(gathering("rows outside", normal({5, 3}), given({4}, {-2, 0, 4, 99}, DType::i32)));
  rows.push_back(gathering("uint8", below({7, 5}, 256, DType::u8), below({6}, 7)));
  rows.push_back(scattering("few rows", {23, 3}, 5));
  rows.back().zero = {{0, 3}, {0}};
  rows.push_back(scattering("vector", {23}, 5));
  rows.push_back(scattering("a long table", {17, 3}, 9001));  // goes by sorting
}

/// Keys [n], or [n,2] with the low word first.
std::vector<size_t> sorted_order(const HostArray& keys) {
  const size_t words = keys.shape.rank() == 2 ? 2 : 1;
  std::vector<size_t> order(keys.values.size() / words);
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    const double *x = &keys.values[a * words], *y = &keys.values[b * words];
    return x[words - 1] < y[words - 1] || (x[words - 1] == y[words - 1] && x[0] < y[0]);
  });
  return order;
}

OpCase sorting(const char* label, const InputSpec& keys, int bits) {
  return {.op = "sort",
          .label = label,
          .inputs = {keys},
          .run = [bits](const Tensors& in) { return sort(in[0], bits).order; },
          .reference =
              [](const HostArrays& in) {
                const std::vector<size_t> order = sorted_order(in[0]);
                HostArray out({in[0].dim(0)});
                std::copy(order.begin(), order.end(), out.values.begin());
                return out;
              },
          .result = DType::i32,
          .gradient = false,
          .tolerance = 0};
}

void add_sorts(OpCases& rows) {
  rows.push_back(sorting("order of floats", normal({101}), 32));
  rows.push_back(sorting("order of int32", given({7}, {5, -3, 0, -3, 1 << 30, -(1 << 30), 5}, DType::i32), 32));
  rows.push_back(sorting("order of many short keys", below({4999}, 13, DType::u32), 4));
  rows.push_back({.op = "sort",
                  .label = "keys",
                  .inputs = {distinct({101})},
                  .run = [](const Tensors& in) { return sort(in[0]).keys; },
                  .reference =
                      [](const HostArrays& in) {
                        HostArray out = in[0];
                        std::sort(out.values.begin(), out.values.end());
                        return out;
                      },
                  .zero = {{0}}});
  rows.push_back(sorting("order of 64 bits", below({4999, 2}, int64_t{1} << 32, DType::u32), 64));
  rows.push_back(sorting("order of 34 bits", below({1001, 2}, 4, DType::u32), 34));
  rows.push_back({.op = "sort",
                  .label = "keys and payload of 64 bits",
                  .inputs = {below({1001, 2}, 23, DType::u32), below({1001}, 1 << 20)},
                  .run =
                      [](const Tensors& in) {
                        const Sorted sorted = sort(in[0], 0, in[1]);
                        return concat({bitcast(sorted.keys, DType::i32), unsqueeze(sorted.order, -1)}, 1);
                      },
                  .reference =
                      [](const HostArrays& in) {
                        const std::vector<size_t> order = sorted_order(in[0]);
                        return from_index({1001, 3}, [&](const Shape& i) {
                          const auto from = static_cast<int64_t>(order[static_cast<size_t>(i[0])]);
                          return i[1] < 2 ? in[0].at({from, i[1]}) : in[1][from];
                        });
                      },
                  .result = DType::i32,
                  .gradient = false,
                  .tolerance = 0});
}

void add_segments(OpCases& rows) {
  const InputSpec offsets = given({6}, {0, 3, 3, 4, 9, 11}, DType::i32);
  rows.push_back({.op = "segment_offsets",
                  .inputs = {given({7}, {0, 0, 2, 2, 2, 5, 7}, DType::i32)},
                  .run = [](const Tensors& in) { return segment_offsets(in[0], 6); },
                  .reference =
                      [](const HostArrays& in) {
                        return from_index({7}, [&](const Shape& i) {
                          return static_cast<double>(
                              std::count_if(in[0].values.begin(), in[0].values.end(),
                                            [&](double id) { return id < static_cast<double>(i[0]); }));
                        });
                      },
                  .result = DType::i32,
                  .tolerance = 0});
  rows.push_back({.op = "segment_sum",
                  .inputs = {normal({11, 3}), offsets},
                  .run = [](const Tensors& in) { return segment_sum(in[0], in[1]); },
                  .reference =
                      [](const HostArrays& in) {
                        return from_index({5, 3}, [&](const Shape& i) {
                          double total = 0;
                          for (auto r = static_cast<int64_t>(in[1][i[0]]); r < static_cast<int64_t>(in[1][i[0] + 1]);
                               r++)
                            total += in[0].at({r, i[1]});
                          return total;
                        });
                      }});
  rows.push_back({.op = "segment_spread",
                  .inputs = {normal({5, 3}), offsets},
                  .run = [](const Tensors& in) { return segment_spread(in[0], in[1], 13); },
                  .reference =
                      [](const HostArrays& in) {
                        HostArray out({13, 3});
                        for (int64_t s = 0; s < 5; s++)
                          for (auto r = static_cast<int64_t>(in[1][s]); r < static_cast<int64_t>(in[1][s + 1]); r++)
                            for (int64_t k = 0; k < 3; k++) out.at({r, k}) = in[0].at({s, k});
                        return out;
                      }});
}

OpCase running(const char* label, const InputSpec& input, int axis, const Cumulative& how) {
  return {.op = "cumsum",
          .label = label,
          .inputs = {input},
          .run = [=](const Tensors& in) { return cumsum(in[0], axis, how); },
          .reference =
              [=](const HostArrays& in) {
                return from_index(in[0].shape, [&](Shape i) {
                  const int64_t own = i[axis];
                  double total = 0;
                  for (int64_t k = 0; k < in[0].dim(axis); k++) {
                    const int64_t ahead = how.reverse ? k - own : own - k;  // above 0: k comes before our place
                    i[axis] = k;
                    if (ahead > 0 || (ahead == 0 && !how.exclusive)) total += in[0].at(i);
                  }
                  return total;
                });
              },
          .result = input.dtype};
}

void add_running(OpCases& rows) {
  rows.push_back(running("last axis", normal({3, 7}), 1, {}));
  rows.back().zero = {{0, 7}};
  rows.push_back(running("first axis, exclusive", normal({7, 3}), 0, {.exclusive = true}));
  rows.push_back(running("reverse", normal({3, 7}), 1, {.reverse = true}));
  rows.push_back(running("whole vectors, both ends", normal({2, 53}), 1, {.exclusive = true, .reverse = true}));
  rows.push_back(
      running("int32, reverse and exclusive", below({2, 301}, 1000), 1, {.exclusive = true, .reverse = true}));
  rows.push_back(running("several chunks", normal({4500}), 0, {}));
  rows.back().reference = [](const HostArrays& in) {  // in one pass: the other is too slow for a row as long
    HostArray out = in[0];
    for (size_t i = 1; i < out.values.size(); i++) out.values[i] += out.values[i - 1];
    return out;
  };
}

}  // namespace

void add_index_cases(OpCases& rows) {
  add_rows_by_number(rows);
  add_sorts(rows);
  add_segments(rows);
  add_running(rows);
}

}  // namespace cloam
