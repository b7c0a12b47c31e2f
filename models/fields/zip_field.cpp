// See zip_field.h.
#include "models/fields/zip_field.h"

#include <algorithm>
#include <cmath>

#include "runtime/ops/volume.h"

namespace cloam {
namespace {

constexpr float kZipTableStart = 1e-4f;
constexpr float kLargestExponent = 15;    // where float32 and the gradient stay finite
constexpr float kColourPadding = 0.001f;  // beyond [0,1] that sigmoids reach
constexpr int64_t kHarmonics = 16;

/// Cells per axis of each level, as the grid's kernel has them.
std::vector<float> cells_of(const HashGrid& grid) {
  std::vector<float> cells;
  for (int level = 0; level < grid.levels; ++level) {
    const double share = grid.levels > 1 ? static_cast<double>(level) / (grid.levels - 1) : 0;
    cells.push_back(
        static_cast<float>(std::floor(grid.coarsest * std::pow(double(grid.finest) / grid.coarsest, share) + 1e-6)));
  }
  return cells;
}

Tensor used_rows_of(const HashGrid& grid) {
  std::vector<float> shares;
  for (const float cells : cells_of(grid)) {
    const double rows = std::min(std::pow(double(cells) + 1, 3), std::pow(2.0, grid.log2_rows));
    shares.push_back(static_cast<float>(1 / (rows * grid.features)));
  }
  return from_host(shares, {grid.levels, 1});
}

}  // namespace

DownweightedGrid::DownweightedGrid(const Scope& scope, const HashGrid& grid)
    : encoder_(grid),
      table_(scope.uniform("table", hash_grid_table_shape(grid), kZipTableStart)),
      cells_(from_host(cells_of(grid), {grid.levels})),
      used_rows_(used_rows_of(grid)) {}

Tensor DownweightedGrid::operator()(const WideSamples& at) const {
  const int64_t count = at.points.dim(0), places = at.points.dim(1);
  const Tensor read = encoder_(reshape(at.points, {count * places, 3}), table_);
  if (at.widths) return downweighted_mean(read, at.widths, cells_);
  return places == 1 ? read : reshape(mean(reshape(read, {count, places, numbers()}), {{1}}), {count, numbers()});
}

Tensor DownweightedGrid::decay() const {
  const int64_t levels = encoder_.grid.levels;
  return sum(sum(square(reshape(table_, {levels, -1})), {{1}, true}) * used_rows_);
}

ZipDensity::ZipDensity(const Scope& scope, const HashGrid& grid, const Options& o)
    : grid_(scope / "grid", grid),
      hidden_(scope / "hidden", grid_.numbers(), o.width),
      out_(scope / "density", o.width, o.outputs),
      exponential_(o.exponential) {}

Tensor ZipDensity::features(const WideSamples& at) const { return out_(hidden_(grid_(at), Activation::relu)); }

Tensor ZipDensity::density(const Tensor& features) const {
  const Tensor x = reshape(slice(features, 1, 0, 1), {features.dim(0)}) - 1.f;
  if (!exponential_) return softplus(x);
  return exp(clamp(x, -kLargestExponent, kLargestExponent));
}

ZipField::ZipField(const Scope& scope, const ZipFieldOptions& o)
    : options_(o),
      geometry_(scope, o.grid, {o.width, o.bottleneck, o.density == "exp"}),
      first_(scope / "colour0", o.bottleneck + kHarmonics, o.colour_width),
      second_(scope / "colour1", o.colour_width + o.bottleneck + kHarmonics, o.colour_width),
      colour_(scope / "colour2", o.colour_width, 3) {}

FieldOutput ZipField::operator()(const WideSamples& at, const Tensor& directions, const Tensor& ray) const {
  const Tensor features = geometry_.features(at);
  const Tensor seen = concat({features, gather_rows(spherical_harmonics(directions), ray)}, 1);
  const Tensor inner = second_(concat({first_(seen, Activation::relu), seen}, 1), Activation::relu);
  return {geometry_.density(features), sigmoid(colour_(inner)) * (1 + 2 * kColourPadding) - kColourPadding};
}

int64_t ZipField::bytes_per_sample(int64_t places) const {
  const int64_t numbers = grid().numbers(),
                layers = options_.width + 2 * options_.bottleneck + 3 * options_.colour_width;
  return 4 * (places * (2 * numbers + options_.grid.levels + 8) + 2 * numbers + 2 * layers);
}

}  // namespace cloam
