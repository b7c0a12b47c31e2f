// Features at points: tri-planes and the hash grid, over uniformly random points.
#include "benchmarks/workload.h"
#include "runtime/error.h"
#include "runtime/ops.h"
#include "runtime/ops/fields.h"
#include "runtime/ops/sample.h"

namespace cloam {
namespace {

constexpr int64_t kMillion = 1 << 20;

Tensor leaf(const Tensor& t) { return parameter(t.to_host(), t.shape()); }

struct Planes {
  int64_t channels, side, samples;
};

/// Bytes: four texels of every plane read, the features written; the gradient reads them and adds to four texels.
Workload planes_workload(const Planes& p) {
  const double texels = 3.0 * 4 * static_cast<double>(p.samples * p.channels);
  return {
      text("triplane.3x", p.channels, "x", p.side, ".1m.fwdbwd"),
      0,
      4 * texels * 2.5,
      [p]() -> Run {
        const Tensor planes = leaf(random_normal({3, p.side, p.side, p.channels}, {1}));
        const Tensor points = random_uniform({p.samples, 3}, {0}), g = random_normal({p.samples, 3 * p.channels}, {2});
        eval({points, g});
        return [=] {
          const Tensor features = sample_planes(planes, points);
          eval({features, grad(features, {planes}, g)[0]});
        };
      },
      {"torch"}};
}
struct GridPoints {
  HashGrid grid;
  std::string count_name;
  int64_t samples;
  bool backward;
};

Run prepare(const GridPoints& p) {
  const HashGridEncoder encode(p.grid);
  const Tensor table = leaf(random_normal(hash_grid_table_shape(p.grid), {1}));
  const Tensor points = random_uniform({p.samples, 3}, {0});
  const Tensor g = random_normal({p.samples, int64_t{p.grid.levels} * p.grid.features}, {2});
  eval({points, g});
  if (!p.backward) return [=] { eval({encode(points, table)}); };
  return [=] {
    const Tensor features = encode(points, table);
    eval({features, grad(features, {table}, g)[0]});
  };
}

void add_grid(Workloads& all, const GridPoints& p) {
  const double corners = 8.0 * p.grid.levels * p.grid.features * static_cast<double>(p.samples);
  all.push_back({text("hashgrid.", p.grid.levels, "x", p.grid.features, ".", p.grid.log2_rows, ".", p.count_name,
                      p.backward ? ".fwdbwd" : ".fwd"),
                 0,
                 4 * corners * (p.backward ? 3 : 1),
                 [p] { return prepare(p); },
                 {}});
}

}  // namespace

void add_field_workloads(Workloads& all) {
  all.push_back(planes_workload({32, 256, kMillion}));
  const HashGrid grid{.levels = 16, .features = 2, .log2_rows = 19, .coarsest = 16, .finest = 2048};
  const std::vector<std::pair<std::string, int64_t>> counts{
      {"1m", kMillion}, {"128k", 131072}, {"16k", 16384}, {"1k", 1024}};
  for (const auto& [name, samples] : counts)
    for (bool backward : {false, true}) add_grid(all, {grid, name, samples, backward});
}

}  // namespace cloam
