// Multiresolution hash grid: Mueller et al., "Instant Neural Graphics Primitives", 2022, section 3.
#include <algorithm>
#include <cmath>

#include "runtime/cl.h"
#include "runtime/ops.h"
#include "runtime/ops/fields.h"
#include "runtime/ops/share.h"

namespace cloam {
namespace {

const Registered kRegistered("hash_grid");

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
  Tensor levels;  // [LEVELS, 2] int32: resolution, corners an axis (0: hashed)
  int64_t rows = 0;
  int level_count = 0, features = 0;
  Constants constants() const { return {{"FEATURES", features}}; }
  /// A kernel of the variant's file, with its constants and ours.
  cl::Kernel& part(const Variant& v, const char* name) const {
    Constants all = v.constants;
    all.push_back({"FEATURES", features});
    return kernel(v.stem.c_str(), name, all);
  }
};

struct GridOp : Op {
  explicit GridOp(GridShape s) : shape(std::move(s)) {}
  GridShape shape;
};

struct HashGridGradTable final : GridOp {
  using GridOp::GridOp;
  const char* name() const override { return "hash_grid_dtable"; }
  void run(const Tensors& in, Tensor& out) const override {
    const Variant& v = choose("grid");
    const int64_t n = in[0].dim(0);
    const Tensor by_level = empty(in[1].shape());
    const Share work = share(n, 1024);
    launch(shape.part(v, "hash_grid_split"), "hash_grid_split", work.range, in[1], by_level, n, shape.level_count,
           work.chunk);
    // Parts only share out the work: every row's sum keeps the order of the samples, so they change no bits.
    const int parts = std::max(1, 2 * device().compute_units / shape.level_count);
    launch(shape.part(v, "hash_grid_dtable"), name(), range1(int64_t{parts} * shape.level_count), in[0], by_level,
           shape.levels, out, n, shape.rows, parts);
  }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override {
    no_gradient("hash_grid", "once differentiable; use finite differences of the field for normals");
  }
};

struct HashGridPairs final : GridOp {
  using GridOp::GridOp;
  const char* name() const override { return "hash_grid_pairs"; }
  void run(const Tensors& in, Tensor& out) const override {
    const int64_t n = in[0].dim(0), items = n * shape.level_count;
    const Tensor rows = empty({items * 8}, DType::i32), values = empty({items * 8, shape.features});
    launch(kernel("grid", "hash_grid_pairs", shape.constants()), name(), elements(items), in[0], in[1], shape.levels,
           rows, values, n, shape.rows, shape.level_count);
    const Tensor sums = scatter_add_rows(values, rows, shape.rows * shape.level_count);
    eval({sums});
    out.node()->storage = dense(sums).node()->storage;
  }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override {
    no_gradient("hash_grid", "once differentiable; use finite differences of the field for normals");
  }
};

struct HashGridGradPoints final : GridOp {
  using GridOp::GridOp;
  const char* name() const override { return "hash_grid_dpoints"; }
  void run(const Tensors& in, Tensor& out) const override {
    const int64_t n = in[0].dim(0);
    const auto [range, chunk] = chunks(n, 1024);
    launch(kernel("grid", "hash_grid_dpoints", shape.constants()), name(), range, in[0], in[1], shape.levels, in[2],
           out, n, shape.rows, shape.level_count, chunk);
  }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override {
    no_gradient("hash_grid", "once differentiable; use finite differences of the field for normals");
  }
};

struct HashGridForward final : GridOp {
  using GridOp::GridOp;
  const char* name() const override { return "hash_grid"; }
  void run(const Tensors& in, Tensor& out) const override {
    const Variant& v = choose("grid");
    const int64_t n = in[0].dim(0);
    auto [range, chunk] = chunks(n, 1024);
    range.global[1] = static_cast<size_t>(shape.level_count);
    if (v.where != "cpu") {
      launch(shape.part(v, "hash_grid"), name(), range, in[0], in[1], shape.levels, out, n, shape.rows,
             shape.level_count, chunk);
      return;
    }
    const Tensor by_level = empty(out.shape());
    launch(shape.part(v, "hash_grid_blocks"), name(), range, in[0], in[1], shape.levels, by_level, n, shape.rows,
           chunk);
    const Share work = share(n, 1024);
    launch(shape.part(v, "hash_grid_join"), "hash_grid_join", work.range, by_level, out, n, shape.level_count,
           work.chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    const bool walk = choose("grid").where == "cpu";
    const Tensor dtable = walk ? make(std::make_shared<HashGridGradTable>(shape), in[1].shape(), {in[0], g})
                               : make(std::make_shared<HashGridPairs>(shape), in[1].shape(), {in[0], g});
    return {make(std::make_shared<HashGridGradPoints>(shape), in[0].shape(), {in[0], in[1], g}), dtable};
  }
};

Tensor level_table(const HashGrid& grid) {
  std::vector<int32_t> values;
  for (const Level& level : levels_of(grid)) values.insert(values.end(), {level.resolution, level.side});
  return from_host(values, {grid.levels, 2});
}

}  // namespace

Shape hash_grid_table_shape(const HashGrid& grid) {
  return {grid.levels * (int64_t{1} << grid.log2_rows), grid.features};
}

HashGridEncoder::HashGridEncoder(const HashGrid& description) : grid(description), levels_(level_table(description)) {
  if (grid.features != 1 && grid.features != 2 && grid.features != 4)
    throw Error(Fault::usage, text("[hash_grid] ", grid.features, " features per level, want 1, 2 or 4"));
}

Tensor HashGridEncoder::operator()(const Tensor& points, const Tensor& table) const {
  match("hash_grid", {{"points", points, "S 3"}, {"table", table, "L F"}});
  if (!(table.shape() == hash_grid_table_shape(grid)))
    throw Error(Fault::internal, text("[hash_grid] table has shape ", to_string(table.shape()), ", want ",
                                      to_string(hash_grid_table_shape(grid))));
  GridShape shape{levels_, int64_t{1} << grid.log2_rows, grid.levels, grid.features};
  return make(std::make_shared<HashGridForward>(shape), {points.dim(0), int64_t{grid.levels} * grid.features},
              {points, table});
}

}  // namespace cloam
