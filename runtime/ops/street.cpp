// Samples along rays through a street with moving boxes.
#include "runtime/ops/street.h"

#include "runtime/cl.h"
#include "runtime/ops.h"
#include "runtime/ops/scan.h"

namespace cloam {
namespace {

constexpr int64_t kBoxNumbers = sizeof(StreetBox) / 4, kGridNumbers = 16;
static_assert(sizeof(StreetBox) == 17 * 4, "kernels/street.cl: Box");

struct Marched {
  StreetRays rays;
  Tensor first_box, boxes, grid, cells, blocks;
};

/// All inputs in memory, and their shapes right.
Marched prepare(const StreetRays& rays, const StreetBoxes& boxes, const StreetGrid& grid) {
  match("street_samples", {{"origins", rays.origins, "R 3"},
                           {"directions", rays.directions, "R 3"},
                           {"jitter", rays.jitter, "R 2"},
                           {"moments", rays.moments, "R"},
                           {"first", boxes.first, "M"}});
  if (boxes.boxes.rank() != 2 || boxes.boxes.dim(1) != kBoxNumbers || boxes.boxes.dtype() != DType::f32)
    throw Error(Fault::internal, text("[street_samples] boxes is ", to_string(boxes.boxes.shape()), " ",
                                      name_of(boxes.boxes.dtype()), ", want what pack_boxes() makes"));
  if (grid.numbers.numel() != kGridNumbers)
    throw Error(Fault::internal, text("[street_samples] the grid's numbers are ", to_string(grid.numbers.shape()),
                                      ", want [", kGridNumbers, "]"));
  eval({rays.origins, rays.directions, rays.jitter, rays.moments, boxes.boxes});
  return {{dense(rays.origins), dense(rays.directions), dense(rays.jitter), dense(rays.moments)},
          dense(boxes.first),
          dense(boxes.boxes),
          dense(grid.numbers),
          dense(grid.cells),
          dense(grid.blocks)};
}

}  // namespace

StreetBoxes pack_boxes(const std::vector<std::vector<StreetBox>>& moments) {
  std::vector<StreetBox> all;
  std::vector<int32_t> first = {0};
  for (const std::vector<StreetBox>& boxes : moments) {
    all.insert(all.end(), boxes.begin(), boxes.end());
    first.push_back(static_cast<int32_t>(all.size()));
  }
  if (all.empty()) all.push_back({});  // no buffer without bytes
  return {from_host(first, {static_cast<int64_t>(first.size())}),
          from_bytes(all.data(), DType::f32, {static_cast<int64_t>(all.size()), kBoxNumbers})};
}

StreetSamples street_samples(const StreetRays& rays, const StreetBoxes& boxes, const StreetGrid& grid,
                             const StreetSteps& steps) {
  const Marched in = prepare(rays, boxes, grid);
  const int64_t count = in.rays.origins.dim(0);
  const auto [range, chunk] = chunks(count + 1, 32);
  const Tensor counts = empty({4, count + 1}, DType::i32), starts = empty({4, count + 1}, DType::i32);
  launch(kernel("street", "street_count"), "street_count", range, in.rays.origins, in.rays.directions, in.rays.jitter,
         in.rays.moments, in.first_box, in.boxes, in.grid, in.cells, in.blocks, counts, count, steps.background,
         steps.actor, steps.sky, steps.shadows ? 1 : 0, chunk);
  scan_rows(counts, starts, 4, {.exclusive = true});
  const auto total = [&](int64_t row) { return int64_t{value_at(starts, (row + 1) * (count + 1) - 1)}; };
  const int64_t all = total(0), background = total(1), actor = total(2), shadow = total(3);
  StreetSamples out;
  const auto part = [&](int64_t row) { return reshape(slice(starts, 0, row, row + 1), {count + 1}); };
  out.offsets = dense(part(0));
  out.shadow_offsets = dense(part(3));
  out.t = empty({all});
  out.rows = empty({all}, DType::i32);
  out.points = empty({background, 3});
  out.ray = empty({background}, DType::i32);
  out.actor_points = empty({actor, 3});
  out.actor_directions = empty({actor, 3});
  out.owners = empty({actor}, DType::i32);
  out.shadow_points = empty({shadow, 3});
  out.shadow_directions = empty({shadow, 3});
  out.shadow_owners = empty({shadow}, DType::i32);
  out.shadow_t = empty({shadow});
  out.shadow_ray = empty({shadow}, DType::i32);
  launch(kernel("street", "street_write"), "street_write", range, in.rays.origins, in.rays.directions, in.rays.jitter,
         in.rays.moments, in.first_box, in.boxes, in.grid, in.cells, in.blocks, starts, out.t, out.rows, out.points,
         out.ray, out.actor_points, out.actor_directions, out.owners, out.shadow_points, out.shadow_directions,
         out.shadow_owners, out.shadow_t, out.shadow_ray, count, steps.background, steps.actor, steps.sky,
         steps.shadows ? 1 : 0, chunk);
  return out;
}

StreetSamples street_lit(const StreetSamples& s, const Tensor& alpha, float least) {
  match("street_lit", {{"alpha", alpha, "S"}, {"rows", s.rows, "S"}});
  const Tensor opacity = dense(alpha);
  const int64_t rays = s.offsets.dim(0) - 1, background = s.points.dim(0);
  const auto [range, chunk] = chunks(rays + 1, 64);
  const Tensor counts = empty({3, rays + 1}, DType::i32), starts = empty({3, rays + 1}, DType::i32);
  launch(kernel("street", "lit_count"), "lit_count", range, opacity, s.rows, s.offsets, counts, rays, background, least,
         chunk);
  scan_rows(counts, starts, 3, {.exclusive = true});
  const auto total = [&](int64_t row) { return int64_t{value_at(starts, (row + 1) * (rays + 1) - 1)}; };
  StreetSamples out = s;  // the places of shadows stay
  out.offsets = dense(reshape(slice(starts, 0, 0, 1), {rays + 1}));
  out.t = empty({total(0)});
  out.rows = empty({total(0)}, DType::i32);
  out.points = empty({total(1), 3});
  out.ray = empty({total(1)}, DType::i32);
  out.actor_points = empty({total(2), 3});
  out.actor_directions = empty({total(2), 3});
  out.owners = empty({total(2)}, DType::i32);
  launch(kernel("street", "lit_write"), "lit_write", range, opacity, s.rows, s.offsets, s.t, s.points, s.actor_points,
         s.actor_directions, s.owners, starts, out.rows, out.t, out.points, out.ray, out.actor_points,
         out.actor_directions, out.owners, rays, background, least, chunk);
  return out;
}

Tensor street_owners(const Tensor& alpha, const StreetSamples& samples) {
  match("street_owners", {{"alpha", alpha, "S"}, {"rows", samples.rows, "S"}});
  const Tensor opacity = dense(alpha);
  const int64_t rays = samples.offsets.dim(0) - 1;
  const Tensor seen = empty({rays}, DType::i32);
  const auto [range, chunk] = chunks(rays, 64);
  launch(kernel("street", "blend_owners"), "blend_owners", range, opacity, samples.rows, samples.offsets,
         samples.owners, seen, rays, samples.points.dim(0), chunk);
  return seen;
}

}  // namespace cloam
