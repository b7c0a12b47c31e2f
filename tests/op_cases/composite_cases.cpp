// Rows of compositing along rays.
#include <cmath>

#include "runtime/ops/composite.h"
#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

constexpr int64_t kSplit = 6;
constexpr double kNear = 0.5;

/// What a row has beside matter, offsets (and features, t), in this order.
struct Parts {
  bool dt = false, rows = false, ranges = false, sky = false;
};

struct Given {
  Given(const HostArrays& in, size_t first, const Parts& which) {
    if (which.dt) dt = &in[first++];
    if (which.rows) rows = &in[first++];
    if (which.ranges) ranges = &in[first];
  }
  int64_t row(int64_t place) const { return rows ? static_cast<int64_t>((*rows)[place]) : place; }
  const HostArray *dt = nullptr, *rows = nullptr, *ranges = nullptr;
};

/// NeRF's equation 3 by place, alpha given or by density; the last of a ray takes what is left for the sky.
HostArray weights(const HostArray& matter, const HostArray& offsets, const Given& with, bool sky) {
  HostArray out(matter.shape);
  for (int64_t ray = 0; ray + 1 < offsets.size(); ray++) {
    double through = 1;
    const auto last = static_cast<int64_t>(offsets[ray + 1]);
    for (auto i = static_cast<int64_t>(offsets[ray]); i < last; i++) {
      const int64_t row = with.row(i);
      const double alpha = with.dt ? 1 - std::exp(-matter[row] * (*with.dt)[row]) : matter[row];
      out[i] = through * (sky && i + 1 == last ? 1 : alpha);
      through *= 1 - alpha;
    }
  }
  return out;
}

double squashed(double t) { return t / (1 + t); }

/// Places [begin, end) of a ray into a row of the result; in: matter, offsets, features, t.
void add_ray(const HostArrays& in, const HostArray& w, const Given& with, bool sky, const Shape& ray, HostArray& out) {
  const HostArray &features = in[2], &t = in[3];
  const int64_t r = ray[0], channels = features.dim(1);
  for (int64_t i = ray[1]; i < ray[2]; i++) {
    const int64_t row = with.row(i);
    const double distance = std::abs(t[i]);
    for (int64_t c = 0; c < channels; c++) out.at({r, c}) += w[i] * features.at({row, c});
    if (!sky || t[i] >= 0) out.at({r, channels}) += w[i];
    out.at({r, channels + 1}) += w[i] * distance;
    if (with.dt) {  // mip-NeRF 360, equation 15
      const double half = (*with.dt)[row] / 2, length = squashed(distance + half) - squashed(distance - half);
      double& distortion = out.at({r, channels + 2});
      for (int64_t j = ray[1]; j < ray[2]; j++)
        distortion += w[i] * w[j] * std::abs(squashed(distance) - squashed(std::abs(t[j])));
      distortion += w[i] * w[i] * length / 3;
    }
    if (!with.ranges) continue;
    const double range = (*with.ranges)[r];
    if (range > 0 && std::abs(distance - range) > kNear) out.at({r, channels + 3}) += w[i] * w[i];
    if (row >= kSplit) out.at({r, channels + 4}) += w[i];
  }
}

HostArray composited(const HostArrays& in, const Parts& which) {
  const Given with(in, 4, which);
  const HostArray w = weights(in[0], in[1], with, which.sky);
  HostArray out({in[1].size() - 1, in[2].dim(1) + (which.ranges ? 5 : 3)});
  for (int64_t r = 0; r < out.dim(0); r++)
    add_ray(in, w, with, which.sky, {r, static_cast<int64_t>(in[1][r]), static_cast<int64_t>(in[1][r + 1])}, out);
  return out;
}

Medium medium(const Tensors& in, size_t first, const Parts& which) {
  const Tensor dt = which.dt ? in[first] : Tensor(), rows = which.rows ? in[first + size_t{which.dt}] : Tensor();
  return {in[0], in[1], dt, rows, which.sky};
}

Contents seen(const Tensors& in, const Parts& which) {
  return {in[2], in[3], which.ranges ? in.back() : Tensor(), static_cast<float>(kNear), kSplit};
}

/// Four rays, one of them empty.
struct Samples {
  InputSpec offsets, t, matter, dt, rows;
};

Samples few(bool density) {
  return {given({5}, {0, 4, 4, 5, 11}, DType::i32),
          constant(given({11}, {1, 1.3, 2, -2.9, 1.7, 0.5, 0.8, 1.9, 2.2, 3.1, -4})),  // |t| ascends in every ray
          density ? between({11}, 0, 5) : between({11}, 0.05, 0.9), constant(between({11}, 0.05, 0.5)),
          given({11}, {4, 0, 9, 2, 7, 1, 10, 3, 5, 8, 6}, DType::i32)};
}

/// Some longer than a vector.
Samples many(bool density) {
  std::vector<double> ascending, rows;
  for (int i = 0; i < 61; i++) ascending.push_back(0.5 + 0.07 * i), rows.push_back(i * 24 % 61);
  return {given({5}, {0, 37, 37, 53, 61}, DType::i32), constant(given({61}, ascending)),
          density ? between({61}, 0, 1) : between({61}, 0, 0.3), constant(between({61}, 0.02, 0.1)),
          given({61}, rows, DType::i32)};
}

void add_parts(OpCase& row, const Samples& s, const Parts& which) {
  if (which.dt) row.inputs.push_back(s.dt);
  if (which.rows) row.inputs.push_back(s.rows);
  if (which.ranges) row.inputs.push_back(constant(given({4}, {2.5, 1, 0, 3})));
}

OpCase sums_row(const char* label, const Samples& s, int64_t channels, const Parts& which) {
  OpCase row{.op = "composite",
             .label = label,
             .inputs = {s.matter, s.offsets, normal({s.matter.shape[0], channels}), s.t},
             .run = [which](const Tensors& in) { return composite(medium(in, 4, which), seen(in, which)); },
             .reference = [which](const HostArrays& in) { return composited(in, which); }};
  add_parts(row, s, which);
  return row;
}

OpCase weights_row(const char* label, const Samples& s, const Parts& which) {
  OpCase row{
      .op = "composite_weights",
      .label = label,
      .inputs = {s.matter, s.offsets},
      .run = [which](const Tensors& in) { return composite_weights(medium(in, 2, which)); },
      .reference = [which](const HostArrays& in) { return weights(in[0], in[1], Given(in, 2, which), which.sky); }};
  add_parts(row, s, which);
  return row;
}

void add_weighted_sums(OpCases& rows) {
  constexpr Parts kNerf{.dt = true}, kStreet{.rows = true, .ranges = true, .sky = true}, kAll{true, true, true, true};
  Samples plain = few(true);
  for (double& t : plain.t.given) t = std::abs(t);
  rows.push_back(sums_row("", plain, 3, kNerf));
  rows.back().zero = {{0}, {1}, {0, 3}, {0}, {0}};
  rows.push_back(sums_row("rays of several vectors", many(true), 3, kNerf));
  rows.push_back(sums_row("densities, many channels", many(true), 67, kNerf));
  rows.push_back(sums_row("densities, all parts", few(true), 5, kAll));
  rows.push_back(sums_row("opacities", plain, 1, {}));
  rows.back().inputs[0] = few(false).matter;
  rows.push_back(sums_row("opacities, rows, sky and ranges", few(false), 5, kStreet));
  rows.push_back(sums_row("opacities, whole vectors", many(false), 32, kStreet));
  for (const Parts& which : {kNerf, kStreet}) {
    OpCase again = sums_row("second order", few(which.dt), 2, which);
    again.second_order = true;
    if (which.dt) again.inputs[3] = plain.t, again.label = "second order, densities";
    rows.push_back(again);
  }
  for (const Parts& which : {kNerf, kStreet, kAll}) {
    OpCase composed = sums_row(which.sky ? which.dt ? "all parts" : "opacities" : "densities",
                               which.sky ? few(which.dt) : plain, 3, which);
    composed.op = "composite_composed";
    composed.run = [which](const Tensors& in) { return composite_composed(medium(in, 4, which), seen(in, which)); };
    rows.push_back(composed);
  }
}

void add_weights(OpCases& rows) {
  rows.push_back(weights_row("", few(true), {.dt = true}));
  rows.back().zero = {{0}, {1}, {0}};
  rows.push_back(weights_row("rays of several vectors", many(true), {.dt = true}));
  rows.push_back(weights_row("densities, rows and sky", few(true), {.dt = true, .rows = true, .sky = true}));
  rows.push_back(weights_row("opacities, rows and sky", many(false), {.rows = true, .sky = true}));
  rows.push_back(weights_row("opacities, second order", few(false), {}));
  rows.back().second_order = true;
  OpCase composed = weights_row("", few(false), {.rows = true, .sky = true});
  composed.op = "composite_weights_composed";
  composed.run = [](const Tensors& in) {
    return composite_weights_composed(medium(in, 2, {.rows = true, .sky = true}));
  };
  rows.push_back(composed);
}

}  // namespace

void add_composite_cases(OpCases& rows) {
  add_weighted_sums(rows);
  add_weights(rows);
}

}  // namespace cloam
