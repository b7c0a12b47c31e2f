// Rows of the reductions.
#include <algorithm>
#include <limits>

#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

using Fold = double (*)(double, double);
double add_up(double a, double b) { return a + b; }
double larger(double a, double b) { return std::max(a, b); }
double smaller(double a, double b) { return std::min(a, b); }

/// Folds the axes in `mask` one element at a time.
Reference folding(Fold fold, double start, uint32_t mask, bool keep) {
  return [=](const HostArrays& in) {
    Shape kept = in[0].shape, shape;
    for (int i = 0; i < kept.rank(); i++) {
      const bool gone = mask >> i & 1u;
      if (!gone || keep) shape.push_back(gone ? 1 : kept[i]);
      if (gone) kept[i] = 1;
    }
    HostArray out(kept, start);
    each_index(in[0].shape, [&](const Shape& index) {
      Shape to = index;
      for (int i = 0; i < to.rank(); i++)
        if (mask >> i & 1u) to[i] = 0;
      out.at(to) = fold(out.at(to), in[0].at(index));
    });
    out.shape = shape;
    return out;
  };
}

OpCase total(const char* label, const Shape& shape, const Reduce& over, uint32_t mask) {
  return {.op = "sum",
          .label = label,
          .inputs = {normal(shape)},
          .run = [over](const Tensors& in) { return sum(in[0], over); },
          .reference = folding(add_up, 0, mask, over.keep)};
}

void add_sums(OpCases& rows) {
  rows.push_back(total("all", {5, 7}, {}, 3));
  rows.push_back(total("last axis", {5, 7}, {{1}}, 2));
  rows.push_back(total("first axis, kept", {5, 7}, {{0}, true}, 1));
  rows.push_back(total("middle axis", {3, 5, 7}, {{-2}}, 2));
  rows.push_back(total("outer axes", {3, 5, 7}, {{0, 2}}, 5));
  rows.back().zero = {{3, 0, 7}};
  // Lengths beyond one lane, one strip and one chunk of the generated kernels.
  rows.push_back(total("long rows", {3, 4099}, {{1}}, 2));
  rows.push_back(total("long columns", {4099, 3}, {{0}}, 1));
  rows.push_back(total("wide columns", {17, 331}, {{0}}, 1));
  rows.push_back(total("all of many", {101, 103}, {}, 3));
  rows.back().bench = {normal({4096, 1024})};
  rows.push_back({.op = "sum",
                  .label = "none of none",
                  .inputs = {normal({0, 7})},
                  .run = [](const Tensors& in) { return sum(in[0]); },
                  .reference = [](const HostArrays&) { return HostArray(Shape{}); }});
  rows.push_back({.op = "sum",
                  .label = "uint8",
                  .inputs = {below({7, 101}, 256, DType::u8)},
                  .run = [](const Tensors& in) { return sum(in[0], {{1}}); },
                  .reference = folding(add_up, 0, 2, false),
                  .result = DType::i32,
                  .tolerance = 0});
}

OpCase extreme(const char* op, const char* label, const InputSpec& input, const Reduce& over, uint32_t mask) {
  const bool is_max = op[1] == 'a';
  const double start = std::numeric_limits<double>::infinity() * (is_max ? -1 : 1);
  return {.op = op,
          .label = label,
          .inputs = {input},
          .run = [=](const Tensors& in) { return is_max ? max(in[0], over) : min(in[0], over); },
          .reference = folding(is_max ? larger : smaller, start, mask, over.keep)};
}

void add_extremes(OpCases& rows) {
  rows.push_back(extreme("max", "last axis", distinct({5, 7}), {{1}}, 2));
  rows.push_back(extreme("min", "last axis", distinct({5, 7}), {{1}}, 2));
  rows.push_back(extreme("max", "all of many", distinct({101, 47}), {}, 3));
  rows.push_back(extreme("max", "first axis, kept", distinct({5, 7}), {{0}, true}, 1));
  rows.push_back(extreme("min", "all", distinct({3, 5, 7}), {}, 7));
  // Central differences see half of what two tied maxima share, as the sub-gradient does.
  rows.push_back(extreme("max", "two ties", given({2, 3}, {1, 3, 3, -2, -5, -2}), {{1}}, 2));
  OpCase whole = extreme("max", "int32", below({5, 101}, 1000), {{1}}, 2);
  whole.result = DType::i32;
  rows.push_back(whole);
}

void add_means(OpCases& rows) {
  rows.push_back({.op = "mean",
                  .inputs = {normal({3, 5, 7})},
                  .run =
                      [](const Tensors& in) {
                        return mean(square(in[0]), {{0, 2}, true});
                      },
                  .reference =
                      [](const HostArrays& in) {
                        HostArray out({1, 5, 1});
                        each_index(in[0].shape, [&](const Shape& i) { out[i[1]] += in[0].at(i) * in[0].at(i) / 21; });
                        return out;
                      },
                  .second_order = true});
  rows.push_back({.op = "sum_to",
                  .inputs = {normal({3, 5, 7})},
                  .run =
                      [](const Tensors& in) {
                        return sum_to(in[0], {5, 1});
                      },
                  .reference =
                      [](const HostArrays& in) {
                        HostArray out({5, 1});
                        each_index(in[0].shape, [&](const Shape& i) { out[i[1]] += in[0].at(i); });
                        return out;
                      }});
}

}  // namespace

void add_reduce_cases(OpCases& rows) {
  add_sums(rows);
  add_extremes(rows);
  add_means(rows);
}

}  // namespace cloam
