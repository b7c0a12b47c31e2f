// Rows of concat, split and pad.
#include <optional>

#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

OpCase joining(const char* label, int axis, const std::vector<Shape>& parts) {
  OpCase row{.op = "concat", .label = label};
  for (const Shape& part : parts) row.inputs.push_back(normal(part));
  row.run = [axis](const Tensors& in) { return concat(in, axis); };
  row.reference = [axis](const HostArrays& in) {
    Shape shape = in[0].shape;
    shape[axis] = 0;
    for (const HostArray& part : in) shape[axis] += part.dim(axis);
    return from_index(shape, [&](Shape i) {
      size_t part = 0;
      while (i[axis] >= in[part].dim(axis)) i[axis] -= in[part++].dim(axis);
      return in[part].at(i);
    });
  };
  return row;
}

OpCase padding(const char* label, int axis, int64_t before, int64_t after) {
  return {.op = "pad",
          .label = label,
          .inputs = {normal({3, 5, 7})},
          .run = [=](const Tensors& in) { return pad(in[0], axis, before, after); },
          .reference =
              [=](const HostArrays& in) {
                Shape shape = in[0].shape;
                shape[axis] += before + after;
                return from_index(shape, [&](Shape i) {
                  i[axis] -= before;
                  return i[axis] < 0 || i[axis] >= in[0].dim(axis) ? 0.0 : in[0].at(i);
                });
              },
          .zero = {{0, 5, 7}}};
}

/// Rows of one long run: llvmpipe ends a work-item that loops 65,535 times, and one lane would copy it all.
void add_long_runs(OpCases& rows) {
  rows.push_back(joining("one long run", 0, {{9}, {70003}}));
  rows.back().gradient = false;
  rows.push_back(padding("one long run", 0, 3, 2));
  rows.back().inputs = {normal({70003})};
  rows.back().zero = {};
  rows.back().gradient = false;
}

struct Windows {
  const char* label;
  Shape image;  // [A,B,H,W,N]
  Window window;
  Shape windows() const {
    return {image[0],
            window.height * window.width,
            image[1],
            window.places(image[2], window.height),
            window.places(image[3], window.width),
            image[4]};
  }
  /// Where in the image a place of a window lies, or nothing.
  std::optional<Shape> pixel(const Shape& i) const {
    const int64_t y = i[3] * window.stride + i[1] / window.width - window.pad,
                  x = i[4] * window.stride + i[1] % window.width - window.pad;
    if (y < 0 || y >= image[2] || x < 0 || x >= image[3]) return std::nullopt;
    return Shape{i[0], i[2], y, x, i[5]};
  }
};

void add_windows(OpCases& rows, const Windows& w) {
  rows.push_back({.op = "unfold",
                  .label = w.label,
                  .inputs = {normal(w.image)},
                  .run = [w](const Tensors& in) { return unfold(in[0], w.window); },
                  .reference =
                      [w](const HostArrays& in) {
                        if (in[0].size() == 0) return HostArray({0, 6, 2, 4, 2, 3});
                        return from_index(w.windows(), [&](const Shape& i) {
                          const auto pixel = w.pixel(i);
                          return pixel ? in[0].at(*pixel) : 0.0;
                        });
                      }});
  rows.push_back({.op = "fold",
                  .label = w.label,
                  .inputs = {normal(w.windows())},
                  .run = [w](const Tensors& in) { return fold(in[0], w.window, w.image[2], w.image[3]); },
                  .reference =
                      [w](const HostArrays& in) {
                        HostArray out(w.image);
                        each_index(w.windows(), [&](const Shape& i) {
                          if (const auto pixel = w.pixel(i)) out.at(*pixel) += in[0].at(i);
                        });
                        return out;
                      }});
}

}  // namespace

void add_join_cases(OpCases& rows) {
  rows.push_back(joining("first axis", 0, {{3, 5}, {1, 5}, {4, 5}}));
  rows.back().zero = {{0, 5}, {2, 5}, {0, 5}};
  rows.push_back(joining("middle axis", 1, {{3, 2, 7}, {3, 5, 7}}));
  rows.push_back(joining("last axis", 2, {{3, 5, 1}, {3, 5, 4}, {3, 5, 2}}));
  OpCase bytes = joining("uint8", 1, {{3, 2}, {3, 5}});
  for (InputSpec& input : bytes.inputs) input = below(input.shape, 256, DType::u8);
  bytes.result = DType::u8;
  rows.push_back(bytes);
  rows.push_back(
      {.op = "split",
       .inputs = {normal({5, 9})},
       .run =
           [](const Tensors& in) {
             const Tensors parts = split(in[0], 1, {2, 3, 4});
             return concat({parts[2], parts[0] * 2.f, parts[1]}, 1);
           },
       .reference =
           [](const HostArrays& in) {
             return from_index({5, 9}, [&](const Shape& i) {
               const int64_t k = i[1];
               return k < 4 ? in[0].at({i[0], k + 5}) : k < 6 ? 2 * in[0].at({i[0], k - 4}) : in[0].at({i[0], k - 4});
             });
           }});
  rows.push_back(padding("last axis", 2, 2, 3));
  rows.push_back(padding("first axis", 0, 1, 0));
  rows.push_back(padding("middle axis", 1, 0, 2));
  add_long_runs(rows);
  add_windows(rows, {"3x3 of a batch", {3, 1, 4, 5, 6}, {3, 3, 1, 1}});
  add_windows(rows, {"2x3, stride 2, no pad", {2, 2, 8, 5, 3}, {2, 3, 2, 0}});
  rows[rows.size() - 2].zero = {{0, 2, 8, 5, 3}};
  add_windows(rows, {"larger than the image", {2, 3, 2, 3, 1}, {5, 3, 2, 3}});
}

}  // namespace cloam
