// Rows of the radiance field ops: perceptrons, grids, planes, sampling of rays.
#include <algorithm>
#include <array>
#include <cmath>

#include "runtime/ops/fields.h"
#include "runtime/ops/sample.h"
#include "runtime/ops/volume.h"
#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

HostArray layer(const HostArray& x, const HostArray& w, bool relu) {
  return from_index({x.dim(0), w.dim(1)}, [&](const Shape& i) {
    double total = 0;
    for (int64_t k = 0; k < w.dim(0); k++) total += x.at({i[0], k}) * w.at({k, i[1]});
    return relu ? std::max(total, 0.0) : total;
  });
}

HostArray perceptron(const HostArrays& in) {
  HostArray x = in[0];
  for (size_t i = 1; i < in.size(); i++) x = layer(x, in[i], i + 1 < in.size());
  return x;
}

void add_perceptrons(OpCases& rows) {
  const auto fused = [](int64_t samples, const std::vector<int64_t>& widths) {
    std::string label = std::to_string(samples) + ":";
    for (int64_t width : widths) label += " " + std::to_string(width);
    OpCase row{.op = "mlp",
               .label = label,
               .inputs = {normal({samples, widths[0]})},
               .reference = perceptron,
               .composed = true};
    for (size_t i = 0; i + 1 < widths.size(); i++) row.inputs.push_back(normal({widths[i], widths[i + 1]}));
    row.run = [](const Tensors& in) { return mlp(in[0], Tensors(in.begin() + 1, in.end())); };
    return row;
  };
  // Every width of a tile; inputs and outputs that fill no vector; one block, several, none.
  rows.push_back(fused(67, {5, 16, 16, 3}));
  rows.push_back(fused(200, {31, 32, 7}));
  rows.push_back(fused(65, {16, 48, 48, 33}));
  rows.push_back(fused(131, {3, 64, 64, 64, 4}));
  rows.push_back(fused(9, {7, 80, 1}));
  rows.push_back(fused(70, {17, 128, 128, 20}));
  rows.push_back(fused(0, {5, 16, 16, 3}));
  OpCase again = fused(2, {3, 16, 2});
  again.label = "second order";
  again.second_order = true;
  rows.push_back(again);
  OpCase composed = fused(7, {5, 6, 3});
  composed.op = "mlp_composed";
  composed.run = [](const Tensors& in) { return mlp_composed(in[0], {in[1], in[2]}); };
  rows.push_back(composed);
}

const HashGrid kGrid{.levels = 3, .features = 2, .log2_rows = 6, .coarsest = 2, .finest = 9};

/// Mueller et al. 2022, equations 2 to 4: N_l = floor(N_min b^l); a corner's row is its place in the dense grid of the
/// level while that fits the table, else the XOR of its coordinates times primes.
double grid_feature(const HostArrays& in, int64_t sample, int level, int64_t feature) {
  const double growth = std::exp(std::log(9.0 / 2.0) / 2);
  const auto cells = static_cast<int64_t>(std::floor(2 * std::pow(growth, level) + 1e-6));
  const uint32_t side = static_cast<uint32_t>(cells) + 1, rows = 64;
  std::array<uint32_t, 3> base{};
  std::array<double, 3> part{};
  for (int64_t axis = 0; axis < 3; axis++) {
    const double at = in[0].at({sample, axis}) * static_cast<double>(cells);
    base[static_cast<size_t>(axis)] =
        static_cast<uint32_t>(std::clamp(std::floor(at), 0.0, static_cast<double>(cells - 1)));
    part[static_cast<size_t>(axis)] = at - base[static_cast<size_t>(axis)];
  }
  const int64_t owners = in[1].dim(0) / (3 * rows), owner = in.size() > 2 ? static_cast<int64_t>(in[2][sample]) : 0;
  double total = 0;
  for (uint32_t corner = 0; corner < 8; corner++) {
    double weight = 1;
    std::array<uint32_t, 3> at{};
    for (uint32_t axis = 0; axis < 3; axis++) {
      const uint32_t up = corner >> axis & 1u;
      at[axis] = base[axis] + up;
      weight *= up ? part[axis] : 1 - part[axis];
    }
    const bool dense = side * side * side <= rows;
    const uint32_t row =
        dense ? at[0] + side * (at[1] + side * at[2]) : (at[0] ^ at[1] * 2654435761u ^ at[2] * 805459861u) % rows;
    total += weight * in[1].at({(level * owners + owner) * rows + row, feature});
  }
  return total;
}

/// One owner without a number, or several.
OpCase grid_row(const char* label, int64_t samples, int64_t owners) {
  OpCase row = {
      .op = "hash_grid",
      .label = label,
      .inputs = {between({samples, 3}, 0, 1), normal(hash_grid_table_shape(kGrid, owners))},
      .run = [](const Tensors& in) { return HashGridEncoder(kGrid)(in[0], in[1], in.size() > 2 ? in[2] : Tensor()); },
      .reference =
          [](const HostArrays& in) {
            return from_index({in[0].dim(0), 6}, [&](const Shape& i) {
              return grid_feature(in, i[0], static_cast<int>(i[1] / 2), i[1] % 2);
            });
          }};
  if (owners > 1) row.inputs.push_back(below({samples}, owners));
  return row;
}

OpCase composed_grid_row(const char* label, int64_t samples, int64_t owners) {
  OpCase row = grid_row(label, samples, owners);
  row.op = "hash_grid_composed";
  row.run = [](const Tensors& in) {
    return HashGridEncoder(kGrid).composed(in[0], in[1], in.size() > 2 ? in[2] : Tensor());
  };
  return row;
}

void add_grids(OpCases& rows) {
  rows.push_back(grid_row("", 71, 1));
  rows.push_back(grid_row("owners", 71, 5));
  rows.push_back(composed_grid_row("", 71, 1));
  rows.push_back(composed_grid_row("owners", 71, 5));
  OpCase again = grid_row("second order", 4, 3);  // points that no difference takes to another cell
  again.inputs[0] = given({4, 3}, {0.07, 0.57, 0.38, 0.68, 0.29, 0.93, 0.41, 0.82, 0.18, 0.32, 0.63, 0.07});
  again.second_order = true;
  rows.push_back(again);
}

/// Widths from nothing, whose weight is 1 in every level, to a whole cube, which the levels hardly see.
double width_of(int64_t sample, int64_t place) {
  return sample == 0 ? 0 : 0.002 * std::pow(2.0, static_cast<double>((3 * sample + place) % 10));
}

/// Barron et al. 2023, section 2: the mean over places of erf(1 / sqrt(8 s^2 n^2)) times the features.
double downweighted(const HostArray& features, const Shape& i, int64_t places, const std::vector<float>& cells) {
  const int64_t each = features.dim(1) / static_cast<int64_t>(cells.size());
  const double side = cells[static_cast<size_t>(i[1] / each)];
  double total = 0;
  for (int64_t place = 0; place < places; place++) {
    const double across = width_of(i[0], place) * side;
    const double weight = across > 0 ? std::erf(1 / std::sqrt(8 * across * across)) : 1;
    total += weight * features.at({i[0] * places + place, i[1]}) / static_cast<double>(places);
  }
  return total;
}

OpCase downweighted_row(int64_t samples, int64_t places, int64_t features, bool composed) {
  const std::vector<float> cells = {2, 9, 31};
  std::vector<float> widths;
  for (int64_t i = 0; i < samples * places; i++) widths.push_back(static_cast<float>(width_of(i / places, i % places)));
  const std::string label = std::to_string(samples) + "x" + std::to_string(places) + ", " + std::to_string(features);
  return {.op = composed ? "downweighted_mean_composed" : "downweighted_mean",
          .label = label,
          .inputs = {normal({samples * places, 3 * features})},
          .run =
              [=](const Tensors& in) {
                const Tensor across = from_host(widths, {samples, places}), levels = from_host(cells, {3});
                return composed ? downweighted_mean_composed(in[0], across, levels)
                                : downweighted_mean(in[0], across, levels);
              },
          .reference =
              [=](const HostArrays& in) {
                return from_index({samples, in[0].dim(1)},
                                  [&](const Shape& i) { return downweighted(in[0], i, places, cells); });
              }};
}

void add_downweighting(OpCases& rows) {
  // Samples and places that fill no block and no vector, a sample's places in two vectors, none.
  rows.push_back(downweighted_row(37, 6, 1, false));
  rows.push_back(downweighted_row(37, 6, 2, false));
  rows.push_back(downweighted_row(19, 7, 4, false));
  rows.push_back(downweighted_row(35, 1, 4, false));
  rows.push_back(downweighted_row(3, 40, 2, false));
  rows.push_back(downweighted_row(600, 3, 1, false));  // of several work-items
  rows.push_back(downweighted_row(0, 6, 2, false));
  rows.push_back(downweighted_row(11, 6, 2, true));
  OpCase again = downweighted_row(3, 2, 2, false);  // of squares: it is linear itself
  again.label = "second order";
  again.second_order = true;
  again.run = [mean = again.run](const Tensors& in) { return mean({square(in[0])}); };
  again.reference = [mean = again.reference](const HostArrays& in) {
    return mean({from_index(in[0].shape, [&](const Shape& i) { return in[0].at(i) * in[0].at(i); })});
  };
  rows.push_back(again);
}

/// Bilinear with half-pixel centres; beyond the outer centres the border value goes on.
double texture(const std::function<double(int64_t, int64_t)>& texel, int64_t height, int64_t width, double u,
               double v) {
  const double x = std::clamp(u * static_cast<double>(width) - 0.5, 0.0, static_cast<double>(width - 1));
  const double y = std::clamp(v * static_cast<double>(height) - 0.5, 0.0, static_cast<double>(height - 1));
  double total = 0;
  for (int64_t row = 0; row < height; row++)
    for (int64_t column = 0; column < width; column++) {
      const double weight = std::max(0.0, 1 - std::abs(x - static_cast<double>(column))) *
                            std::max(0.0, 1 - std::abs(y - static_cast<double>(row)));
      total += weight * texel(row, column);
    }
  return total;
}

using Sampler = Tensor (*)(const Tensor& images, const Tensor& points, const Tensor& owners);

/// Images [(3,)(A,)H,W,C]: 3 of each owner for points of three axes, A with owners.
struct Sampling {
  const char* op;
  Sampler run;
  int64_t axes = 3;
};

OpCase sampling_row(const Sampling& how, const char* label, const Shape& images, int64_t samples) {
  const int64_t count = how.axes == 3 ? 3 : 1;
  const auto reference = [count](const HostArrays& in) {
    constexpr std::array<std::array<int64_t, 2>, 3> kAxes{{{0, 1}, {0, 2}, {1, 2}}};
    const int64_t channels = in[0].dim(-1), height = in[0].dim(-3), width = in[0].dim(-2);
    const int64_t owned = in[0].size() / (count * height * width * channels);
    return from_index({in[1].dim(0), count * channels}, [&](const Shape& i) {
      const int64_t image = i[1] / channels * owned + (in.size() > 2 ? static_cast<int64_t>(in[2][i[0]]) : 0);
      const auto texel = [&](int64_t row, int64_t column) {
        return in[0][((image * height + row) * width + column) * channels + i[1] % channels];
      };
      const auto& axes = kAxes[static_cast<size_t>(i[1] / channels)];
      return texture(texel, height, width, in[1].at({i[0], axes[0]}), in[1].at({i[0], axes[1]}));
    });
  };
  OpCase row = {
      .op = how.op,
      .label = label,
      .inputs = {normal(images), between({samples, how.axes}, 0, 1)},
      .run = [run = how.run](const Tensors& in) { return run(in[0], in[1], in.size() > 2 ? in[2] : Tensor()); },
      .reference = reference};
  const int owner_axis = count == 3 ? 1 : 0;
  if (images.rank() == owner_axis + 4) row.inputs.push_back(below({samples}, images[owner_axis]));
  return row;
}

/// Points that no difference of the second order takes to another texel: the middles between centres of 4 and of 5.
InputSpec between_centres(int64_t axes) {
  const std::vector<double> all = {0.2, 0.28, 0.44, 0.42, 0.71, 0.69, 0.68, 0.33, 0.46};
  return given({9 / axes, axes}, {all.begin(), all.begin() + 9 / axes * axes});
}

void add_images(OpCases& rows) {
  const Sampling planes{"sample_planes", sample_planes}, images{"sample_images", sample_images, 2};
  rows.push_back(sampling_row(planes, "", {3, 5, 4, 2}, 11));
  rows.push_back(sampling_row(planes, "whole vectors, several bands", {3, 37, 3, 16}, 53));
  rows.push_back(sampling_row(planes, "one texel", {3, 1, 1, 32}, 3));
  rows.push_back(sampling_row(planes, "no points", {3, 2, 2, 16}, 0));
  rows.push_back(sampling_row(planes, "four lanes", {3, 7, 5, 12}, 23));
  rows.push_back(sampling_row(planes, "owners", {3, 4, 3, 4, 2}, 29));
  rows.push_back(sampling_row(planes, "owners, bands across them", {3, 5, 13, 3, 12}, 61));
  rows.push_back(sampling_row(images, "", {5, 4, 3}, 13));
  rows.push_back(sampling_row(images, "owners, whole vectors", {4, 19, 3, 16}, 47));
  rows.push_back(sampling_row({"sample_planes_composed", sample_planes_composed}, "owners", {3, 4, 3, 4, 2}, 29));
  rows.push_back(sampling_row({"sample_images_composed", sample_images_composed, 2}, "", {5, 4, 3}, 13));
  for (const Sampling& how : {planes, images}) {
    OpCase again = sampling_row(how, "second order", how.axes == 3 ? Shape{3, 4, 5, 2} : Shape{4, 5, 2}, 9 / how.axes);
    again.inputs[1] = between_centres(how.axes);
    again.second_order = true;
    rows.push_back(again);
  }
}

/// The place whose share of all weight before it is u, and the old edges, in order. Every bin gets 1e-5 more, so that
/// none is without weight (bmild/nerf, run_nerf_helpers.py, sample_pdf).
HostArray resampled(const HostArrays& in) {
  const int64_t rays = in[0].dim(0), bins = in[1].dim(1), fresh = in[2].dim(1);
  HostArray out({rays, bins + 1 + fresh});
  for (int64_t ray = 0; ray < rays; ray++) {
    std::vector<double> cdf = {0}, edges;
    for (int64_t b = 0; b < bins; b++) cdf.push_back(cdf.back() + in[1].at({ray, b}) + 1e-5);
    for (int64_t b = 0; b <= bins; b++) edges.push_back(in[0].at({ray, b}));
    std::vector<double> merged = edges;
    for (int64_t k = 0; k < fresh; k++) {
      const double goal = in[2].at({ray, k}) * cdf.back();
      size_t b = 0;
      while (b + 2 < cdf.size() && cdf[b + 1] < goal) b++;
      merged.push_back(edges[b] + (edges[b + 1] - edges[b]) * (goal - cdf[b]) / (cdf[b + 1] - cdf[b]));
    }
    std::sort(merged.begin(), merged.end());
    for (size_t k = 0; k < merged.size(); k++) out.at({ray, static_cast<int64_t>(k)}) = merged[k];
  }
  return out;
}

void add_sampling(OpCases& rows) {
  rows.push_back(
      {.op = "importance_edges",
       .inputs = {given({2, 5}, {0, 0.5, 1, 2, 4, 1, 1.5, 2, 2.5, 3}), given({2, 4}, {0.1, 0, 0.7, 0.2, 0, 0, 1, 0}),
                  given({2, 3}, {0.05, 0.4, 0.95, 0.01, 0.5, 0.99})},
       .run = [](const Tensors& in) { return importance_edges(in[0], in[1], in[2]); },
       .reference = resampled,
       .gradient = false});
  for (bool contract : {false, true})
    rows.push_back({.op = "unit_points",
                    .label = contract ? "contracted" : "as they are",
                    .inputs = {between({23, 3}, -3, 3)},
                    .run = [contract](const Tensors& in) { return unit_points(in[0], contract); },
                    .reference =
                        [contract](const HostArrays& in) {
                          return from_index(in[0].shape, [&](const Shape& i) {
                            double longest = 0;  // mip-NeRF 360, equation 10, with the maximum norm
                            for (int64_t k = 0; k < 3; k++) longest = std::max(longest, std::abs(in[0].at({i[0], k})));
                            const double x = in[0].at(i);
                            if (!contract) return (x + 1) / 2;
                            return ((longest <= 1 ? x : (2 - 1 / longest) * x / longest) + 2) / 4;
                          });
                        }});
  rows.push_back({.op = "march",
                  .label = "rays that are full",
                  .inputs = {normal({6, 3}), normal({6, 3}), between({6, 1}, 0, 1), between({6}, 0, 1)},
                  .run =
                      [](const Tensors& in) {
                        const MarchOptions every_step{.side = 4, .capacity = 5, .min_step = 0.25f};
                        const Tensor span = concat({in[2], in[2] + 9.f}, 1);
                        return march({in[0], in[1], span}, in[3], full({64}, 1), every_step).t;
                      },
                  .reference =
                      [](const HostArrays& in) {
                        return from_index({30}, [&](const Shape& i) {
                          const auto ray = static_cast<size_t>(i[0] / 5);
                          return in[2][ray] + 0.25 * (in[3][ray] + static_cast<double>(i[0] % 5) + 0.5);
                        });
                      },
                  .gradient = false});
}

/// (-1)^m K P_l^|m|(cos theta) cos or sin of |m| phi, from the definition.
double harmonic(int l, int m, double x, double y, double z) {
  const auto order = static_cast<unsigned>(std::abs(m));
  double ratio = 1;  // (l - |m|)! / (l + |m|)!
  for (int k = l - std::abs(m) + 1; k <= l + std::abs(m); k++) ratio /= k;
  const double k =
      std::sqrt((2 * l + 1) / (4 * M_PI) * ratio) * std::assoc_legendre(static_cast<unsigned>(l), order, z);
  const double phi = std::atan2(y, x), sign = order % 2 ? -1 : 1;
  if (m == 0) return k;
  return sign * std::sqrt(2.0) * k * (m > 0 ? std::cos(order * phi) : std::sin(order * phi));
}

void add_harmonics(OpCases& rows) {
  rows.push_back({.op = "spherical_harmonics",
                  .inputs = {normal({23, 3})},
                  .run =
                      [](const Tensors& in) {
                        return spherical_harmonics(in[0] * rsqrt(sum(square(in[0]), {{1}, true})));
                      },
                  .reference =
                      [](const HostArrays& in) {
                        return from_index({23, 16}, [&](const Shape& i) {
                          const double x = in[0].at({i[0], 0}), y = in[0].at({i[0], 1}), z = in[0].at({i[0], 2});
                          const double length = std::sqrt(x * x + y * y + z * z);
                          const int l = static_cast<int>(std::sqrt(static_cast<double>(i[1])));
                          return harmonic(l, static_cast<int>(i[1]) - l * l - l, x / length, y / length, z / length);
                        });
                      },
                  .gradient = false});
}

}  // namespace

void add_field_cases(OpCases& rows) {
  add_perceptrons(rows);
  add_grids(rows);
  add_downweighting(rows);
  add_images(rows);
  add_sampling(rows);
  add_harmonics(rows);
}

}  // namespace cloam
