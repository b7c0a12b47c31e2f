// Volume rendering along rays: marching, compositing and the occupancy grid.
#include "runtime/ops/volume.h"

#include <cmath>
#include <memory>

#include "benchmarks/workload.h"
#include "runtime/error.h"
#include "runtime/ops.h"
#include "runtime/ops/composite.h"

namespace cloam {
namespace {

constexpr int kSide = 128;
constexpr int64_t kCells = int64_t{kSide} * kSide * kSide;

Tensor leaf_like(const Tensor& t) { return parameter(t.to_host(), t.shape()); }

/// Optical thickness of one step: a ball's surface, about one cell in twelve.
Tensor shell() {
  std::vector<float> cells(kCells);
  for (int64_t i = 0; i < kCells; i++) {
    const auto along = [](int64_t k) { return (static_cast<float>(k % kSide) + 0.5f) / 64 - 1; };
    const float r = std::hypot(along(i), along(i / kSide), along(i / kSide / kSide));
    cells[static_cast<size_t>(i)] = std::abs(r - 0.6f) < 0.1f ? 0.5f : 0.f;
  }
  return from_host(cells, {kCells});
}

MarchOptions steps() {
  MarchOptions m;
  m.side = kSide;
  m.min_step = 0.01f;
  m.threshold = 0.1f;
  return m;
}

/// Parallel rays, at random through the square that the cube shows.
Rays rays_of(int64_t count) {
  const Tensor place = random_uniform({count, 2}, {1}) * 2.f - 1.f;
  const auto rows = [&](const std::vector<float>& row) {
    const auto width = static_cast<int64_t>(row.size());
    return from_host(row, {1, width}) + zeros({count, width});
  };
  return {concat({place, full({count, 1}, -2.f)}, 1), rows({0, 0, 1}), rows({1, 3})};
}

/// Bytes: a ray's place, direction, span and shift read; its samples written, as many as steps fit into its share of
/// the shell's volume.
Workload march_workload(const std::string& name, int64_t count) {
  const double shell_volume = 4.0 / 3 * M_PI * (std::pow(0.7, 3) - std::pow(0.5, 3)), samples = shell_volume / 4 / 0.01;
  return {"march." + name,
          0,
          static_cast<double>(count) * (36 + 24 * samples),
          [=]() -> Run {
            const Rays rays = rays_of(count);
            const Tensor jitter = random_uniform({count}, {2}), cells = shell();
            eval({rays.origins, rays.directions, rays.span, jitter, cells});
            return [=] { march(rays, jitter, cells, steps()); };
          },
          {}};
}

struct Composited {
  std::string rays_name;
  int64_t rays, samples;  // of each ray
  bool backward;
};

Run prepare(const Composited& c) {
  const int64_t n = c.rays * c.samples;
  const Tensor sigma = leaf_like(random_uniform({n}, {1})), rgb = leaf_like(random_uniform({n, 3}, {2}));
  std::vector<int32_t> begins;
  for (int64_t r = 0; r <= c.rays; r++) begins.push_back(static_cast<int32_t>(r * c.samples));
  const Tensor dt = 0.05f + 0.01f * random_uniform({n}, {3}),
               t = reshape(cumsum(full({c.rays, c.samples}, 0.05f), 1), {n});
  const Tensor offsets = from_host(begins, {c.rays + 1}), g = random_normal({c.rays, 6}, {4});
  eval({t, dt, g, offsets});
  if (!c.backward) return [=] { eval({composite({sigma, offsets, dt}, {rgb, t})}); };
  return [=] {
    const Tensor seen = composite({sigma, offsets, dt}, {rgb, t});
    const Tensors d = grad(seen, {sigma, rgb}, g);
    eval({seen, d[0], d[1]});
  };
}

/// Bytes: six numbers of a sample read; for the gradient once more, and four written.
void add_composite(Workloads& all, const Composited& c) {
  const double samples = static_cast<double>(c.rays * c.samples);
  all.push_back({text("composite.", c.rays_name, "x", c.samples, c.backward ? ".fwdbwd" : ".fwd"),
                 0,
                 samples * (c.backward ? 24 + 24 + 16 : 24),
                 [c] { return prepare(c); },
                 {}});
}

struct Street {
  int64_t rays, samples, channels;  // samples: of each ray
  bool backward;
};

/// Every ray sees the background (two thirds of its samples, in a list of their own), then an actor, then the sky.
Run prepare(const Street& s) {
  const int64_t n = s.rays * s.samples, background = s.rays * (s.samples - s.samples / 3);
  const Tensor alpha = leaf_like(0.3f * random_uniform({n}, {1})),
               features = leaf_like(random_normal({n, s.channels}, {2}));
  std::vector<int32_t> rows, begins = {0};
  for (int64_t r = 0, near = 0, actor = background; r < s.rays; r++) {
    for (int64_t i = 0; i < s.samples; i++)
      rows.push_back(static_cast<int32_t>(i >= s.samples / 3 && i < 2 * (s.samples / 3) ? actor++ : near++));
    begins.push_back(static_cast<int32_t>(rows.size()));
  }
  const Tensor t = reshape(cumsum(full({s.rays, s.samples}, 0.05f), 1), {n}), ranges = full({s.rays}, 1.f);
  const Tensor rows_of = from_host(rows, {n}), offsets = from_host(begins, {s.rays + 1}),
               g = random_normal({s.rays, s.channels + 5}, {4});
  eval({t, ranges, g});
  const auto seen = [=] {
    return composite({alpha, offsets, {}, rows_of, true}, {features, t, ranges, 0.1f, background});
  };
  if (!s.backward) return [=] { eval({seen()}); };
  return [=] {
    const Tensor all = seen();
    const Tensors d = grad(all, {alpha, features}, g);
    eval({all, d[0], d[1]});
  };
}

/// Bytes: opacity, features, place and row of a sample read; for the gradient once more, and all but place and row
/// written.
void add_street(Workloads& all, const Street& s) {
  const double samples = static_cast<double>(s.rays * s.samples), row = 4.0 * static_cast<double>(s.channels + 1);
  all.push_back(
      {text("composite.rows.", s.rays / 1024, "kx", s.samples, "x", s.channels, s.backward ? ".fwdbwd" : ".fwd"),
       0,
       samples * (s.backward ? 3 * row + 16 : row + 8),
       [s] { return prepare(s); },
       {}});
}

/// A quarter of the cells. Bytes: shift read, number and point written; number and density read, the value changed.
Workload occupancy_workload() {
  return {text("occupancy.", kSide),
          0,
          (28.0 + 16) * kCells / 4,
          []() -> Run {
            const int64_t n = kCells / 4;
            const Tensor jitter = random_uniform({n, 3}, {1}), density = random_uniform({n}, {2});
            auto values = std::make_shared<Tensor>(shell());
            eval({jitter, density});
            return [=] {
              const OccupancyCells visited = occupancy_cells(jitter, kSide, 17, 1000003);
              occupancy_merge(*values, visited.cells, density, 0.95f);
            };
          },
          {}};
}

}  // namespace

void add_volume_workloads(Workloads& all) {
  all.push_back(march_workload("1k", 1024));
  all.push_back(march_workload("64k", 65536));
  for (bool backward : {false, true}) {
    add_composite(all, {"64k", 65536, 64, backward});
    add_composite(all, {"4k", 4096, 24, backward});
    for (int64_t channels : {16, 32}) add_street(all, {8192, 48, channels, backward});
  }
  all.push_back(occupancy_workload());
}

}  // namespace cloam
