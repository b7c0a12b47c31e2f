// Marching, sampling and occupancy: where rays through a volume have samples.
#include "runtime/ops/volume.h"

#include <algorithm>

#include "runtime/cl.h"
#include "runtime/ops.h"
#include "runtime/ops/composed.h"
#include "runtime/ops/scan.h"
#include "runtime/ops/share.h"

namespace cloam {
namespace {

const Registered kVolumeKernels[] = {Registered("importance_edges"), Registered("unit_points"),
                                     Registered("spherical_harmonics")};

struct ImportanceEdges final : Op {
  const char* name() const override { return "importance_edges"; }
  void run(const Tensors& in, Tensor& out) const override {
    const int64_t rays = in[0].dim(0);
    const auto [range, chunk] = chunks(rays, 16);
    launch(kernel("volume", name()), name(), range, in[0], in[1], in[2], out, rays, in[1].dim(1), in[2].dim(1), chunk);
  }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override { return {}; }
};

/// unit_points() by other ops, for its gradient.
Tensor composed_unit_points(const Tensor& points, bool contract) {
  if (!contract) return points * 0.5f + 0.5f;
  const Tensor folded = maximum(max(abs(points), {{1}, true}), 1.f);
  return points * ((2.f - 1.f / folded) / folded) * 0.25f + 0.5f;
}

struct UnitPoints final : Op {
  explicit UnitPoints(bool fold) : contract(fold) {}
  const char* name() const override { return "unit_points"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(in[0].dim(0), 4096);
    launch(kernel("volume", name()), name(), range, in[0], out, in[0].dim(0), chunk, contract ? 1 : 0);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return vjp_of([fold = contract](const Tensors& x) { return composed_unit_points(x[0], fold); }, in, g);
  }
  bool contract;
};

struct SphericalHarmonics final : Op {
  const char* name() const override { return "spherical_harmonics"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(in[0].dim(0), 1024);
    launch(kernel("volume", name()), name(), range, in[0], out, in[0].dim(0), chunk);
  }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override { return {}; }
};

/// Results whose inputs gradients stop at.
Tensor untracked(Tensor out) {
  out.node()->tracked = false;
  return out;
}

int32_t last_value(const Tensor& offsets) {
  int32_t total = 0;
  read_buffer(*offsets.node()->storage.buffer, static_cast<size_t>(offsets.numel() - 1) * 4, 4, &total);
  return total;
}

}  // namespace

namespace {

/// Offsets from counts [R+1], and room for that many samples.
RaySamples packed(const Tensor& counts) {
  RaySamples out;
  out.offsets = empty(counts.shape(), DType::i32);
  scan_rows(counts, out.offsets, 1, {.exclusive = true});
  const int64_t samples = last_value(out.offsets);
  out.points = empty({samples, 3});
  out.t = empty({samples});
  out.dt = empty({samples});
  out.ray = empty({samples}, DType::i32);
  return out;
}

}  // namespace

RaySamples march(const Rays& rays, const Tensor& jitter, const Tensor& cells, const MarchOptions& m) {
  match("march", {{"origins", rays.origins, "R 3"},
                  {"directions", rays.directions, "R 3"},
                  {"span", rays.span, "R 2"},
                  {"jitter", jitter, "R"}});
  if (cells.numel() != int64_t{m.side} * m.side * m.side)
    throw Error(Fault::internal,
                text("[march] cells has shape ", to_string(cells.shape()), ", want ", m.side, "^3 values"));
  eval({rays.origins, rays.directions, rays.span, jitter, cells});
  const Tensor o = dense(rays.origins), d = dense(rays.directions), span = dense(rays.span), shift = dense(jitter),
               grid = dense(cells);
  const int64_t count = o.dim(0);
  const auto [range, chunk] = chunks(count, 64);
  const Tensor scratch = empty({count, m.capacity}), counts = empty({count + 1}, DType::i32);
  launch(kernel("volume", "march"), "march", range, o, d, span, shift, grid, scratch, counts, count, chunk, m.side,
         m.contract ? 1 : 0, m.capacity, m.min_step, m.max_step, m.cone, m.threshold, m.explore);
  const RaySamples out = packed(counts);
  launch(kernel("volume", "gather_samples"), "gather_samples", range, o, d, scratch, out.offsets, out.points, out.t,
         out.dt, out.ray, count, chunk, m.contract ? 1 : 0, m.capacity, m.min_step, m.max_step, m.cone);
  return out;
}

RaySamples visible(const RaySamples& s, const Tensor& sigma, float least) {
  match("visible", {{"sigma", sigma, "S"}, {"t", s.t, "S"}});
  const Tensor density = dense(sigma);
  const int64_t count = s.offsets.dim(0) - 1;
  const auto [range, chunk] = chunks(count, 64);
  const Tensor counts = empty({count + 1}, DType::i32);
  launch(kernel("volume", "visible_counts"), "visible_counts", range, density, s.dt, s.offsets, counts, count, chunk,
         least);
  const RaySamples out = packed(counts);
  launch(kernel("volume", "keep_visible"), "keep_visible", range, s.points, s.t, s.dt, s.offsets, out.offsets,
         out.points, out.t, out.dt, out.ray, count, chunk);
  return out;
}

Tensor importance_edges(const Tensor& edges, const Tensor& weights, const Tensor& uniform) {
  const Dims d =
      match("importance_edges", {{"edges", edges, "R E"}, {"weights", weights, "R N"}, {"uniform", uniform, "R M"}});
  if (d["E"] != d["N"] + 1)
    throw Error(Fault::internal, text("[importance_edges] ", d["E"], " edges for ", d["N"],
                                      " weights, want one more edge than weights"));
  return untracked(make(std::make_shared<ImportanceEdges>(), {d["R"], d["E"] + d["M"]}, {edges, weights, uniform}));
}

Tensor unit_points(const Tensor& points, bool contract) {
  match("unit_points", {{"points", points, "S 3"}});
  return make(std::make_shared<UnitPoints>(contract), points.shape(), {points});
}

Tensor spherical_harmonics(const Tensor& directions) {
  match("spherical_harmonics", {{"directions", directions, "S 3"}});
  return untracked(make(std::make_shared<SphericalHarmonics>(), {directions.dim(0), 16}, {directions}));
}

OccupancyCells occupancy_cells(const Tensor& jitter, int side, int64_t start, int64_t stride) {
  const Tensor shift = dense(jitter);
  const int64_t n = shift.dim(0);
  OccupancyCells out{empty({n}, DType::i32), empty({n, 3})};
  const WorkShare work = share(n, 1024);
  launch(kernel("volume", "occupancy_cells"), "occupancy_cells", work.range, shift, out.cells, out.points, n, side,
         start, stride, work.chunk);
  return out;
}

void occupancy_merge(Tensor& values, const Tensor& cells, const Tensor& density, float decay) {
  const Tensor new_density = dense(density);
  const WorkShare work = share(cells.numel(), 1024);
  launch(kernel("volume", "occupancy_merge"), "occupancy_merge", work.range, cells, new_density, values, cells.numel(),
         decay, work.chunk);
}

}  // namespace cloam
