// Multiresolution hash grid: Mueller et al., "Instant Neural Graphics Primitives", 2022, section 3.
#include <algorithm>
#include <cmath>
#include <limits>

#include "runtime/cl.h"
#include "runtime/ops/composed.h"
#include "runtime/ops/fields.h"
#include "runtime/ops/places.h"
#include "runtime/ops/share.h"

namespace cloam {
namespace {

const Registered kGridKernels("hash_grid");

struct Level {
  int resolution, side;
};

std::vector<Level> levels_of(const HashGrid& grid) {
  const int64_t rows = int64_t{1} << grid.log2_rows;
  const double growth =
      grid.levels > 1 ? std::exp(std::log(static_cast<double>(grid.finest) / grid.coarsest) / (grid.levels - 1)) : 1.0;
  std::vector<Level> levels;
  for (int l = 0; l < grid.levels; l++) {
    const int resolution = static_cast<int>(std::floor(grid.coarsest * std::pow(growth, l) + 1e-6));
    const int64_t side = resolution + 1;
    levels.push_back({resolution, side * side * side <= rows ? static_cast<int>(side) : 0});
  }
  return levels;
}

struct GridShape {
  std::vector<Level> each;
  Tensor levels;  // [LEVELS, 2] int32: resolution, corners an axis (0: hashed)
  int64_t rows = 0;
  int features = 0;
  int64_t level_count() const { return static_cast<int64_t>(each.size()); }
  int64_t owned(const Shape& table) const { return table[0] / (rows * level_count()); }
  /// A kernel of the variant's file, with its constants and ours.
  cl::Kernel& part(const Variant& v, const char* name) const { return kernel(v, name, {{"FEATURES", features}}); }
};

Tensor composed_grid(const Tensors& in, const GridShape& shape);

struct GridOp : Op {
  explicit GridOp(GridShape s) : shape(std::move(s)) {}
  GridShape shape;
};

/// in: points, perhaps owners, g -> as the table.
struct HashGridGradTable final : GridOp {
  using GridOp::GridOp;
  const char* name() const override { return "hash_grid_dtable"; }
  void run(const Tensors& in, Tensor& out) const override {
    const Variant& v = choose("grid");
    v.where == "cpu" ? by_walk(v, in, out) : by_pairs(v, in, out);
  }
  void by_walk(const Variant& v, const Tensors& in, const Tensor& out) const;
  void by_pairs(const Variant& v, const Tensors& in, Tensor& out) const;
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override {
    const auto gradient = [shape = shape, table = out.shape()](const Tensors& of) {
      Tensors own = {zeros(table)};  // whatever it is: features are linear in it
      own.insert(own.end(), of.begin(), of.end() - 1);
      return vjp_of([&](const Tensors& x) { return composed_grid(x, shape); }, own, of.back())[0];
    };
    return vjp_of(gradient, in, g);
  }
};

void HashGridGradTable::by_walk(const Variant& v, const Tensors& in, const Tensor& out) const {
  const Places of(in, 0, in.size() - 1);
  const int64_t n = of.points.dim(0), levels = shape.level_count();
  const Tensor by_level = empty(in.back().shape());
  const WorkShare work = share(n, 1024);
  launch(shape.part(v, "hash_grid_split"), "hash_grid_split", work.range, in.back(), by_level, n, levels, work.chunk);
  // Parts only share out the work: every row's sum keeps the order of the samples, so they change no bits.
  const int64_t parts = std::max<int64_t>(1, 2 * device().compute_units / levels);
  launch(shape.part(v, "hash_grid_dtable"), name(), range1(parts * levels), of.points, of.owners, by_level,
         shape.levels, out, n, shape.owned(out.shape()), shape.rows, parts);
}

void HashGridGradTable::by_pairs(const Variant& v, const Tensors& in, Tensor& out) const {
  const Places of(in, 0, in.size() - 1);
  const int64_t n = of.points.dim(0), items = n * shape.level_count();
  const Tensor rows = empty({items * 8}, DType::i32), values = empty({items * 8, shape.features});
  launch(shape.part(v, "hash_grid_pairs"), "hash_grid_pairs", elements(items), of.points, of.owners, in.back(),
         shape.levels, rows, values, n, shape.owned(out.shape()), shape.rows, shape.level_count());
  const Tensor sums = scatter_add_rows(values, rows, out.dim(0));
  adopt(out, sums);
}

/// in: the table, points, perhaps owners, g -> [S,3].
struct HashGridGradPoints final : GridOp {
  using GridOp::GridOp;
  const char* name() const override { return "hash_grid_dpoints"; }
  void run(const Tensors& in, Tensor& out) const override {
    const Places of(in, 1, in.size() - 1);
    const int64_t n = out.dim(0);
    const auto [range, chunk] = chunks(n, 1024);
    launch(kernel("grid", name(), {{"FEATURES", shape.features}}), name(), range, of.points, of.owners, in[0],
           shape.levels, in.back(), out, n, shape.owned(in[0].shape()), shape.rows, shape.level_count(), chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return vjp_of_gradient([shape = shape](const Tensors& x) { return composed_grid(x, shape); }, 1, in, g);
  }
};

/// in: the table, points, perhaps owners -> [S, LEVELS * FEATURES].
struct HashGridForward final : GridOp {
  using GridOp::GridOp;
  const char* name() const override { return "hash_grid"; }
  void run(const Tensors& in, Tensor& out) const override {
    const Variant& v = choose("grid");
    const Places of(in, 1, in.size());
    const int64_t n = out.dim(0), owned = shape.owned(in[0].shape()), levels = shape.level_count();
    auto [range, chunk] = chunks(n, 1024);
    range.global[1] = static_cast<size_t>(levels);
    if (v.where != "cpu") {
      launch(shape.part(v, "hash_grid"), name(), range, of.points, of.owners, in[0], shape.levels, out, n, owned,
             shape.rows, levels, chunk);
      return;
    }
    const Tensor by_level = empty(out.shape());
    launch(shape.part(v, "hash_grid_blocks"), name(), range, of.points, of.owners, in[0], shape.levels, by_level, n,
           owned, shape.rows, chunk);
    const WorkShare work = share(n, 1024);
    launch(shape.part(v, "hash_grid_join"), "hash_grid_join", work.range, by_level, out, n, levels, work.chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    Tensors all = in, gradients(in.size());
    all.push_back(g);
    gradients[0] = make(std::make_shared<HashGridGradTable>(shape), in[0].shape(), Tensors(all.begin() + 1, all.end()));
    gradients[1] = make(std::make_shared<HashGridGradPoints>(shape), in[1].shape(), all);
    return gradients;
  }
};

// ---- Composition: the eight corners of a cell are an axis.

/// x of [S,8,3] along its last axis -> [S,8].
Tensor along(const Tensor& x, int axis) { return reshape(slice(x, 2, axis, axis + 1), {x.dim(0), x.dim(1)}); }

/// Corners u32 [S,8,3] -> their rows, i32 [S,8].
Tensor rows_of(const Tensor& corners, const Level& level, int64_t rows) {
  if (level.side > 0) {
    const Tensor x = along(corners, 0), y = along(corners, 1), z = along(corners, 2);
    return cast(x + level.side * (y + level.side * z), DType::i32);
  }
  const Tensor mixed = corners * from_host(std::vector<uint32_t>{1, 2654435761u, 805459861u}, {3});
  const Tensor hash = bit_xor(bit_xor(along(mixed, 0), along(mixed, 1)), along(mixed, 2));
  return cast(modulo(hash, static_cast<int>(rows)), DType::i32);
}

/// Of points [S,3] in one level: the rows of the corners i32 [S,8], and their weights.
std::pair<Tensor, Tensor> corners_of(const Tensor& points, const Level& level, int64_t rows) {
  const auto cells = static_cast<float>(level.resolution);
  const Tensor at = points * cells, base = clamp(floor(at), 0.f, cells - 1.f);
  const Tensor up = from_host(
      std::vector<uint32_t>{0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 0, 1, 1, 0, 1, 0, 1, 1, 1, 1, 1}, {1, 8, 3});
  const Tensor part = unsqueeze(at - base, 1);
  const Tensor each = where(equal(up, 1), part, 1.f - part);
  return {rows_of(unsqueeze(cast(base, DType::u32), 1) + up, level, rows),
          along(each, 0) * along(each, 1) * along(each, 2)};
}

Tensor composed_grid(const Tensors& in, const GridShape& shape) {
  const Places of(in, 1, in.size());
  const auto rows = static_cast<int>(shape.rows), all = rows * static_cast<int>(shape.owned(in[0].shape()));
  Tensors features;
  for (const Level& level : shape.each) {
    auto [row, weight] = corners_of(of.points, level, rows);
    row = row + static_cast<int>(features.size()) * all;
    if (of.owned) row = row + unsqueeze(of.owners, 1) * rows;
    features.push_back(sum(gather_rows(in[0], row) * unsqueeze(weight, 2), {.axes = {1}}));
  }
  return concat(features, 1);
}

Tensor level_table(const HashGrid& grid) {
  std::vector<int32_t> values;
  for (const Level& level : levels_of(grid)) values.insert(values.end(), {level.resolution, level.side});
  return from_host(values, {grid.levels, 2});
}

/// The inputs of the op, of right shapes.
Tensors inputs(const HashGrid& grid, const Tensor& points, const Tensor& table, const Tensor& owners) {
  match("hash_grid", {{"points", points, "S 3"}, {"table", table, "L F"}});
  check_owners("hash_grid", owners, points);
  const int64_t one = hash_grid_table_shape(grid)[0], owned = owners ? std::max<int64_t>(1, table.dim(0) / one) : 1;
  const Shape wanted = hash_grid_table_shape(grid, owned);
  if (!(table.shape() == wanted) || wanted[0] > std::numeric_limits<int32_t>::max())
    throw Error(Fault::internal, text("[hash_grid] table has shape ", to_string(table.shape()), ", want ",
                                      to_string(wanted), ", of fewer than 2^31 rows"));
  return owners ? Tensors{table, points, owners} : Tensors{table, points};
}

GridShape shape_of(const HashGrid& grid, const Tensor& levels) {
  return {levels_of(grid), levels, int64_t{1} << grid.log2_rows, grid.features};
}

}  // namespace

Shape hash_grid_table_shape(const HashGrid& grid, int64_t owners) {
  return {grid.levels * owners * (int64_t{1} << grid.log2_rows), grid.features};
}

HashGridEncoder::HashGridEncoder(const HashGrid& description) : grid(description), levels_(level_table(description)) {
  if (grid.features != 1 && grid.features != 2 && grid.features != 4)
    throw Error(Fault::usage, text("[hash_grid] ", grid.features, " features per level, want 1, 2 or 4"));
}

Tensor HashGridEncoder::operator()(const Tensor& points, const Tensor& table, const Tensor& owners) const {
  return make(std::make_shared<HashGridForward>(shape_of(grid, levels_)),
              {points.dim(0), int64_t{grid.levels} * grid.features}, inputs(grid, points, table, owners));
}

Tensor HashGridEncoder::composed(const Tensor& points, const Tensor& table, const Tensor& owners) const {
  return cloam::composed_grid(inputs(grid, points, table, owners), shape_of(grid, levels_));
}

}  // namespace cloam
