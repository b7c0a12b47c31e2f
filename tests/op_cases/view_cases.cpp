// Rows of the views.
#include <cstring>

#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

OpCase reshaping(const char* label, const Shape& from, const Shape& to, std::function<Tensor(const Tensors&)> run) {
  return {.op = "reshape",
          .label = label,
          .inputs = {normal(from)},
          .run = std::move(run),
          .reference = [to](const HostArrays& in) {
            HostArray out(to);
            out.values = in[0].values;
            return out;
          }};
}

void add_reshapes(OpCases& rows) {
  rows.push_back(reshaping("joins axes", {3, 5, 7}, {15, 7}, [](const Tensors& in) {
    return reshape(in[0], {15, 7});
  }));
  rows.push_back(reshaping("splits an axis", {30, 7}, {5, 2, 3, 7}, [](const Tensors& in) {
    return reshape(in[0], {5, -1, 3, 7});
  }));
  rows.push_back(reshaping("across axes", {6, 10}, {4, 15}, [](const Tensors& in) { return reshape(in[0], {4, 15}); }));
  rows.push_back(reshaping("drops ones", {1, 5, 1, 7}, {5, 7, 1}, [](const Tensors& in) {
    return reshape(in[0], {5, 7, 1});
  }));
  rows.push_back(reshaping("unsqueeze", {5, 7}, {5, 1, 7}, [](const Tensors& in) { return unsqueeze(in[0], 1); }));
  rows.push_back({.op = "reshape",
                  .label = "of a transposed tensor",
                  .inputs = {normal({5, 6})},
                  .run =
                      [](const Tensors& in) {
                        return reshape(transpose(in[0]), {3, 10});
                      },
                  .reference =
                      [](const HostArrays& in) {
                        return from_index({3, 10}, [&](const Shape& i) {
                          const int64_t flat = i[0] * 10 + i[1];
                          return in[0].at({flat % 5, flat / 5});
                        });
                      }});
}

void add_orders(OpCases& rows) {
  rows.push_back({.op = "permute",
                  .inputs = {normal({3, 5, 7})},
                  .run =
                      [](const Tensors& in) {
                        return permute(in[0], {2, 0, 1});
                      },
                  .reference =
                      [](const HostArrays& in) {
                        return from_index({in[0].dim(2), in[0].dim(0), in[0].dim(1)}, [&](const Shape& i) {
                          return in[0].at({i[1], i[2], i[0]});
                        });
                      },
                  .zero = {{3, 0, 7}}});
  rows.push_back({.op = "permute",
                  .label = "transpose",
                  .inputs = {normal({3, 5, 7})},
                  .run = [](const Tensors& in) { return transpose(in[0]); },
                  .reference =
                      [](const HostArrays& in) {
                        return from_index({3, 7, 5}, [&](const Shape& i) { return in[0].at({i[0], i[2], i[1]}); });
                      }});
}

OpCase slicing(const char* label, const Shape& from, int axis, const std::vector<int64_t>& range) {
  return {.op = "slice",
          .label = label,
          .inputs = {normal(from)},
          .run = [=](const Tensors& in) { return slice(in[0], axis, range[0], range[1], range[2]); },
          .reference =
              [=](const HostArrays& in) {
                Shape to = from;
                to[axis] = (range[1] - range[0] + range[2] - 1) / range[2];
                return from_index(to, [&](Shape i) {
                  i[axis] = range[0] + i[axis] * range[2];
                  return in[0].at(i);
                });
              }};
}

void add_rest(OpCases& rows) {
  rows.push_back({.op = "broadcast_to",
                  .inputs = {normal({5, 1})},
                  .run =
                      [](const Tensors& in) {
                        return broadcast_to(in[0], {3, 5, 7});
                      },
                  .reference =
                      [](const HostArrays& in) {
                        return from_index({3, 5, 7}, [&](const Shape& i) { return in[0].spread(i); });
                      }});
  rows.push_back({.op = "broadcast_to",
                  .label = "no elements",
                  .inputs = {normal({1, 7})},
                  .run =
                      [](const Tensors& in) {
                        return broadcast_to(in[0], {0, 7});
                      },
                  .reference =
                      [](const HostArrays&) {
                        return HostArray({0, 7});
                      }});
  rows.push_back({.op = "bitcast",
                  .inputs = {constant(normal({5, 7}))},
                  .run = [](const Tensors& in) { return bitcast(in[0], DType::i32); },
                  .reference = elementwise([](const double* x) {
                    const auto value = static_cast<float>(x[0]);
                    int32_t bits = 0;
                    std::memcpy(&bits, &value, 4);
                    return static_cast<double>(bits);
                  }),
                  .result = DType::i32,
                  .tolerance = 0});
  rows.push_back({.op = "full",
                  .run =
                      [](const Tensors&) {
                        return full({3, 5}, 2.5f) + zeros({5}) - ones({3, 1});
                      },
                  .reference =
                      [](const HostArrays&) {
                        return HostArray({3, 5}, 1.5);
                      }});
}

}  // namespace

void add_view_cases(OpCases& rows) {
  add_reshapes(rows);
  add_orders(rows);
  rows.push_back(slicing("a range", {5, 7}, 1, {2, 6, 1}));
  rows.push_back(slicing("steps that end early", {11, 3}, 0, {1, 9, 3}));
  rows.push_back(slicing("steps to the end", {3, 11}, 1, {0, 11, 2}));
  rows.push_back(slicing("nothing", {5, 7}, 0, {3, 3, 1}));
  add_rest(rows);
}

}  // namespace cloam
