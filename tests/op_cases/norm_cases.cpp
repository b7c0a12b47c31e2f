// Rows of softmax, normalisations, attention and resizing.
#include <algorithm>
#include <cmath>

#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

/// Softmax from its definition; safe for the small values it is given.
HostArray soft(const HostArray& x, int axis) {
  HostArray out(x.shape);
  each_index(x.shape, [&](const Shape& index) {
    Shape i = index;
    double total = 0;
    for (i[axis] = 0; i[axis] < x.shape[axis]; i[axis]++) total += std::exp(x.at(i) - x.at(index));
    out.at(index) = 1 / total;
  });
  return out;
}

OpCase softening(const char* op, const char* label, const InputSpec& input, int axis, bool log) {
  return {.op = op,
          .label = label,
          .inputs = {input},
          .run = [=](const Tensors& in) { return log ? log_softmax(in[0], axis) : softmax(in[0], axis); },
          .reference =
              [=](const HostArrays& in) {
                HostArray out = soft(in[0], axis);
                if (log)
                  for (double& value : out.values) value = std::log(value);
                return out;
              },
          .composed = true};
}

void add_softmax(OpCases& rows) {
  rows.push_back(softening("softmax", "last axis", normal({5, 7}), 1, false));
  rows.back().second_order = true;
  rows.back().zero = {{0, 7}};
  rows.push_back(softening("softmax", "middle axis", normal({3, 5, 2}), 1, false));
  rows.back().strided_gradient = false;
  rows.push_back(softening("softmax", "large values", given({2, 3}, {200, 201, 199, -300, -302, -301}), 1, false));
  rows.push_back(softening("softmax", "long rows", normal({3, 211}), 1, false));
  rows.push_back(softening("softmax", "many rows", normal({131, 16}), 1, false));
  rows.push_back(softening("log_softmax", "", normal({5, 7}), 1, true));
  rows.back().second_order = true;
  rows.push_back(softening("log_softmax", "long rows", normal({3, 211}), 1, true));
}

constexpr double kEpsilon = 1e-5F;

/// Mean 0 and variance 1 over each of the runs of `length` neighbouring values.
HostArray standard(HostArray x, int64_t length) {
  for (int64_t begin = 0; begin < x.size(); begin += length) {
    double average = 0, variance = 0;
    for (int64_t i = begin; i < begin + length; i++) average += x[i] / static_cast<double>(length);
    for (int64_t i = begin; i < begin + length; i++)
      variance += (x[i] - average) * (x[i] - average) / static_cast<double>(length);
    for (int64_t i = begin; i < begin + length; i++) x[i] = (x[i] - average) / std::sqrt(variance + kEpsilon);
  }
  return x;
}

OpCase layer_normalising(const char* label, const Shape& x) {
  const int64_t n = x.back();
  return {.op = "layer_norm",
          .label = label,
          .inputs = {normal(x), normal({n}), normal({n})},
          .run = [](const Tensors& in) { return layer_norm(in[0], in[1], in[2]); },
          .reference =
              [n](const HostArrays& in) {
                HostArray out = standard(in[0], n);
                for (int64_t i = 0; i < out.size(); i++) out[i] = out[i] * in[1][i % n] + in[2][i % n];
                return out;
              },
          .composed = true};
}

void add_layer_norms(OpCases& rows) {
  rows.push_back(layer_normalising("", {3, 5, 7}));
  rows.back().zero = {{0, 5, 7}, {7}, {7}};
  rows.push_back(layer_normalising("long rows", {3, 211}));
  rows.push_back(layer_normalising("many rows", {1031, 16}));
  rows.push_back(layer_normalising("one row", {16}));
  // Linear in beta, whose second derivatives are there only once something follows.
  rows.push_back(layer_normalising("squared", {3, 5, 7}));
  rows.back().second_order = true;
  rows.back().run = [](const Tensors& in) { return square(layer_norm(in[0], in[1], in[2])); };
  rows.back().reference = [plain = rows.back().reference](const HostArrays& in) {
    HostArray out = plain(in);
    for (double& y : out.values) y *= y;
    return out;
  };
}

struct Grouping {
  const char* label;
  Shape x;
  int groups;
  bool affine, embedded, silu;
};

/// The rows of group_norm: x, then gamma and beta, then scale and shift.
OpCase group_normalising(const Grouping& g) {
  OpCase row{.op = "group_norm", .label = g.label, .inputs = {normal(g.x)}, .composed = true};
  const int64_t channels = g.x[1];
  if (g.affine) row.inputs.insert(row.inputs.end(), 2, normal({channels}));
  if (g.embedded) row.inputs.insert(row.inputs.end(), 2, normal({g.x[0], channels}));
  row.run = [g](const Tensors& in) {
    GroupNormOptions with{.silu = g.silu};
    if (g.embedded) with.scale = in[in.size() - 2], with.shift = in.back();
    return group_norm(in[0], g.groups, g.affine ? in[1] : Tensor(), g.affine ? in[2] : Tensor(), with);
  };
  row.reference = [g, channels](const HostArrays& in) {
    const int64_t images = std::max<int64_t>(1, in[0].dim(0)), pixels = in[0].size() / (images * channels);
    HostArray out = standard(in[0], channels / g.groups * pixels);
    for (int64_t i = 0; i < out.size(); i++) {
      double& y = out[i];
      const int64_t c = i / pixels;
      if (g.affine) y = y * in[1][c % channels] + in[2][c % channels];
      if (g.embedded) y = y * (1 + in[in.size() - 2][c]) + in.back()[c];
      if (g.silu) y /= 1 + std::exp(-y);
    }
    return out;
  };
  return row;
}

void add_group_norms(OpCases& rows) {
  rows.push_back(group_normalising({"", {2, 6, 3, 5}, 3, true, false, false}));
  rows.back().zero = {{0, 6, 3, 5}, {6}, {6}};
  rows.push_back(group_normalising({"silu, whole vectors", {2, 4, 16, 5}, 2, true, false, true}));
  rows.push_back(group_normalising({"silu, embedding", {3, 4, 7, 5}, 2, true, true, true}));
  rows.back().second_order = true;
  rows.push_back(group_normalising({"embedding alone", {2, 3, 17}, 1, false, true, false}));
  rows.push_back(group_normalising({"no affine, one channel a group", {2, 3, 11, 3}, 3, false, false, true}));
  rows.push_back(group_normalising({"no pixels", {5, 12}, 2, true, false, false}));
  rows.push_back(group_normalising({"many rows", {9, 10, 3}, 10, true, false, false}));
  rows.push_back(group_normalising({"far from 0", {2, 4, 9, 9}, 2, false, false, false}));
  rows.back().inputs = {between({2, 4, 9, 9}, 99, 101)};
  rows.back().tolerance = 5e-5;  // the mean itself is rounded; sums of plain squares would be off by 2e-3
}

HostArray attended(const HostArrays& in, double scale) {
  const HostArray &q = in[0], &k = in[1], &v = in[2];
  const HostArray scores = from_index({q.dim(0), q.dim(1), k.dim(1)}, [&](const Shape& i) {
    double total = 0;
    for (int64_t d = 0; d < q.dim(2); d++) total += q.at({i[0], i[1], d}) * k.at({i[0], i[2], d});
    return total * scale;
  });
  const HostArray share = soft(scores, 2);
  return from_index({q.dim(0), q.dim(1), v.dim(2)}, [&](const Shape& i) {
    double total = 0;
    for (int64_t u = 0; u < k.dim(1); u++) total += share.at({i[0], i[1], u}) * v.at({i[0], u, i[2]});
    return total;
  });
}

struct Attending {
  const char* label;
  Shape q, k, v;
};

OpCase attending(const Attending& a) {
  const double scale = 1 / std::sqrt(static_cast<double>(a.q.back()));
  return {.op = "attention",
          .label = a.label,
          .inputs = {normal(a.q), normal(a.k), normal(a.v)},
          .run = [](const Tensors& in) { return attention(in[0], in[1], in[2]); },
          .reference = [scale](const HostArrays& in) { return attended(in, scale); },
          .composed = true};
}

void add_attention(OpCases& rows) {
  rows.push_back(attending({"", {2, 5, 4}, {2, 7, 4}, {2, 7, 3}}));
  rows.back().second_order = true;
  rows.back().zero = {{0, 5, 4}, {0, 7, 4}, {0, 7, 3}};
  rows.back().bench = {normal({8, 1024, 64}), normal({8, 1024, 64}), normal({8, 1024, 64})};
  rows.back().bench_flops = 4.0 * 8 * 1024 * 1024 * 64;
  rows.push_back(attending({"own scale", {2, 5, 4}, {2, 7, 4}, {2, 7, 3}}));
  rows.back().run = [](const Tensors& in) { return attention(in[0], in[1], in[2], 0.25f); };
  rows.back().reference = [](const HostArrays& in) { return attended(in, 0.25); };
  rows.push_back(attending({"beyond a block", {1, 137, 17}, {1, 151, 17}, {1, 151, 33}}));
  rows.push_back(attending({"whole blocks", {1, 64, 32}, {1, 128, 32}, {1, 128, 32}}));
  rows.push_back(attending({"wide", {1, 67, 100}, {1, 33, 100}, {1, 33, 12}}));
  rows.push_back(attending({"widest", {1, 4, 130}, {1, 35, 130}, {1, 35, 260}}));
  rows.push_back(attending({"one query", {3, 1, 8}, {3, 2, 8}, {3, 2, 8}}));
  rows.push_back(attending({"leading axes", {2, 3, 5, 4}, {2, 3, 6, 4}, {2, 3, 6, 4}}));
  rows.back().reference = [](HostArrays in) {
    for (HostArray& x : in) x.shape = {6, x.dim(2), x.dim(3)};
    HostArray out = attended(in, 0.5);
    out.shape = {2, 3, 5, 4};
    return out;
  };
  // Scores of -800 and less, and some that grow along the keys: sums begin small and are corrected.
  rows.push_back(attending({"large scores", {1, 3, 1}, {1, 300, 1}, {1, 300, 2}}));
  rows.back().inputs[0] = constant(given({1, 3, 1}, {-8, 2, 0.1}));
  rows.back().inputs[1] = between({1, 300, 1}, 100, 104);
  // Scores that grow by 60 over three blocks of keys, and some that fall: what was summed shrinks many times.
  std::vector<double> steps;
  for (int i = 0; i < 300; i++) steps.push_back(0.2 * i);
  rows.push_back(attending({"growing scores", {1, 3, 1}, {1, 300, 1}, {1, 300, 2}}));
  rows.back().inputs[0] = constant(given({1, 3, 1}, {1, -1, 0.5}));
  rows.back().inputs[1] = given({1, 300, 1}, steps);
}

/// How much place i of `to` takes of place k of `from`: a box or a triangle around the centre, the borders going on.
double share_of(bool bilinear, int64_t i, int64_t k, int64_t from, int64_t to) {
  const double centre = (static_cast<double>(i) + 0.5) * static_cast<double>(from) / static_cast<double>(to);
  if (!bilinear) return static_cast<int64_t>(std::floor(centre)) == k ? 1 : 0;
  const double at = std::clamp(centre - 0.5, 0.0, static_cast<double>(from - 1));
  return std::max(0.0, 1 - std::abs(at - static_cast<double>(k)));
}

/// Calls visit(from index, to index, weight) for every pair of pixels that meet.
template <class Visit>
void each_pair(const Shape& from, const Shape& to, bool bilinear, Visit visit) {
  each_index(to, [&](const Shape& o) {
    for (int64_t y = 0; y < from[2]; y++)
      for (int64_t x = 0; x < from[3]; x++) {
        const double weight = share_of(bilinear, o[2], y, from[2], to[2]) * share_of(bilinear, o[3], x, from[3], to[3]);
        if (weight != 0) visit(Shape{o[0], o[1], y, x}, o, weight);
      }
  });
}

Tensor resized(const Tensor& x, const Shape& to, bool bilinear) {
  return bilinear ? resize_bilinear(x, to[2], to[3]) : resize_nearest(x, to[2], to[3]);
}

/// x [N,C,H,W] as large as the factors from -> to make it: benchmarks give larger images than the rows do.
Shape scaled(const Tensor& x, const Shape& from, const Shape& to) {
  return {x.dim(0), x.dim(1), x.dim(2) * to[2] / from[2], x.dim(3) * to[3] / from[3]};
}

OpCase resizing(const char* label, const Shape& from, const Shape& to, bool bilinear) {
  return {.op = "resize",
          .label = label,
          .inputs = {normal(from)},
          .run = [=](const Tensors& in) { return resized(in[0], scaled(in[0], from, to), bilinear); },
          .reference =
              [=](const HostArrays& in) {
                HostArray out({in[0].dim(0), to[1], to[2], to[3]});
                each_pair(in[0].shape, out.shape, bilinear,
                          [&](const Shape& i, const Shape& o, double w) { out.at(o) += w * in[0].at(i); });
                return out;
              }};
}

OpCase resizing_back(const char* label, const Shape& from, const Shape& to, bool bilinear) {
  return {.op = "resize_adjoint",
          .label = label,
          .inputs = {normal(to)},
          .run =
              [=](const Tensors& in) {
                const Shape small = scaled(in[0], to, from);
                const Tensor x = parameter(std::vector<float>(static_cast<size_t>(numel(small))), small);
                return grad(sum(resized(x, in[0].shape(), bilinear) * in[0]), {x})[0];
              },
          .reference =
              [=](const HostArrays& in) {
                HostArray out(from);
                each_pair(from, to, bilinear,
                          [&](const Shape& i, const Shape& o, double w) { out.at(i) += w * in[0].at(o); });
                return out;
              }};
}

void add_resizes(OpCases& rows) {
  rows.push_back(resizing("nearest, twice as large", {2, 3, 3, 5}, {2, 3, 6, 10}, false));
  rows.back().zero = {{0, 3, 3, 5}};
  rows.push_back(resizing("nearest, odd factors", {1, 2, 5, 7}, {1, 2, 13, 3}, false));
  rows.push_back(resizing("bilinear, larger", {2, 1, 3, 5}, {2, 1, 7, 11}, true));
  rows.back().bench = {normal({4, 32, 64, 64})};
  rows.push_back(resizing("bilinear, smaller", {1, 2, 11, 13}, {1, 2, 4, 5}, true));
  rows.push_back(resizing("bilinear, one pixel", {1, 1, 1, 4}, {1, 1, 3, 1}, true));
  rows.push_back(resizing_back("nearest", {1, 2, 5, 7}, {1, 2, 13, 3}, false));
  rows.push_back(resizing_back("bilinear", {1, 2, 5, 4}, {1, 2, 17, 3}, true));
  rows.push_back(resizing_back("nearest, twice as large", {2, 3, 6, 5}, {2, 3, 12, 10}, false));
  rows.back().bench = {normal({4, 32, 64, 64})};
  rows.push_back(resizing_back("bilinear, along rows", {2, 3, 7, 5}, {2, 3, 7, 11}, true));
}

}  // namespace

void add_norm_cases(OpCases& rows) {
  add_softmax(rows);
  add_layer_norms(rows);
  add_group_norms(rows);
  add_attention(rows);
  add_resizes(rows);
}

}  // namespace cloam
