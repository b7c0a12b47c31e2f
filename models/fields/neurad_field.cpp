// See neurad_field.h.
#include "models/fields/neurad_field.h"

#include <cmath>

#include "runtime/error.h"

namespace cloam {
namespace {

constexpr float kTableStart = 1e-3f;

int64_t numbers(const HashGrid& grid) { return int64_t{grid.levels} * grid.features; }

Tensor resolutions(const HashGrid& grid) {
  std::vector<float> cells;
  for (int level = 0; level < grid.levels; ++level) {
    const double share = grid.levels > 1 ? static_cast<double>(level) / (grid.levels - 1) : 1;
    cells.push_back(static_cast<float>(grid.coarsest * std::pow(double(grid.finest) / grid.coarsest, share)));
  }
  return from_host(cells, {1, grid.levels});
}

NeuradFieldOptions checked(const NeuradFieldOptions& o) {
  if (numbers(o.actors) > numbers(o.background))
    throw Error(Fault::usage,
                text("settings grid.* and actors.*: the actors' grid says ", numbers(o.actors),
                     " numbers of a point, the background's ", numbers(o.background), ", want at least as many"));
  return o;
}

}  // namespace

NeuradField::NeuradField(const Scope& background, const Scope& actors, const Scope& network,
                         const NeuradFieldOptions& o, int64_t actor_count)
    : downweight_(o.downweight),
      background_(checked(o).background),
      actors_(o.actors),
      background_table_(background.uniform("table", hash_grid_table_shape(o.background), kTableStart)),
      network_(network, numbers(o.background), o.network) {
  if (actor_count > 0)
    actors_table_ = actors.uniform("table", hash_grid_table_shape(o.actors, actor_count), kTableStart);
}

Tensor NeuradField::read(const HashGridEncoder& grid, const Tensor& table, const FieldPoints& at) const {
  const Tensor all = grid(at.points, table, at.owners);
  if (!downweight_) return all;
  const Tensor kept = 1.f / maximum(unsqueeze(at.widths, 1) * resolutions(grid.grid) * 2.f, 1.f);
  const int64_t count = at.points.dim(0), levels = grid.grid.levels, features = grid.grid.features;
  return reshape(reshape(all, {count, levels, features}) * unsqueeze(stop_gradient(kept), 2),
                 {count, levels * features});
}

Tensor NeuradField::encoded(const FieldPoints& background, const FieldPoints& actors) const {
  Tensors parts;
  if (background.points.dim(0) > 0) parts.push_back(read(background_, background_table_, background));
  if (actors.points && actors.points.dim(0) > 0) {
    const Tensor own = read(actors_, actors_table_, actors);
    const int64_t missing = numbers(background_.grid) - numbers(actors_.grid);
    parts.push_back(missing > 0 ? pad(own, 1, 0, missing) : own);
  }
  return parts.size() == 1 ? parts.front() : concat(parts, 0);
}

}  // namespace cloam
