// 3D Gaussians as a camera sees them: projection, colours, and the tiles that they reach.
#include <bit>
#include <limits>

#include "runtime/cl.h"
#include "runtime/ops/composed.h"
#include "runtime/ops/places.h"
#include "runtime/ops/scan.h"
#include "runtime/ops/splat_composed.h"

namespace cloam {
namespace {

const Registered kSplatProjectKernels[] = {Registered("splat_project"), Registered("splat_colours")};

constexpr int64_t kSeen = 7, kTile = 16, kViewNumbers = 12, kLensNumbers = 6;

/// Inputs of an op: places in `views` (where there are none, a buffer for the argument that is not read).
struct Owners {
  Owners(const Tensors& in, size_t first, size_t end) : owned(end > first), rows(owned ? in[first] : in[0]) {}
  const bool owned;
  const Tensor& rows;
};

/// What each owner's rows add up to, or all rows without owners: [N,...].
Tensor by_owner(const Tensor& rows, const Owners& owners, int64_t count) {
  return owners.owned ? scatter_add_rows(rows, owners.rows, count) : sum(rows, {.axes = {0}, .keep = true});
}

/// A row of views or eyes [N,...] for each of `count` gaussians.
Tensor own_rows(const Tensor& of_owners, const Owners& owners, int64_t count) {
  if (owners.owned) return gather_rows(of_owners, owners.rows);
  Shape shape = of_owners.shape();
  shape[0] = count;
  return broadcast_to(of_owners, shape);
}

/// in: means, scales, rotations, logits, views [N,3,4], lens [6], perhaps owners, g -> [G,11], or [G,23] with the
/// pose's part.
struct ProjectGrad final : Op {
  ProjectGrad(const SplatLook& how, bool pose) : look(how), with_pose(pose) {}
  const char* name() const override { return "splat_project_grad"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 256);
    const Owners owners(in, 6, in.size() - 1);
    launch(kernel("splat_project", "project_grad"), name(), range, in[0], in[1], in[2], in[3], in[4], owners.rows,
           owners.owned ? 1 : 0, in[5], in.back(), out, out.dim(0), look.blur, look.near, look.antialiased ? 1 : 0,
           with_pose ? 1 : 0, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    const auto rows = [look = look, with_pose = with_pose](const Tensors& of) {
      const int64_t count = of[0].dim(0);
      const Tensor views = own_rows(of[4], Owners(of, 6, of.size() - 1), count);
      const Tensors own = {of[0], of[1], of[2], of[3], views, of[5]};
      const Tensors each = vjp_of([&](const Tensors& x) { return project_composed(x, look); }, own, of.back());
      Tensors columns = {each[0], each[1], each[2], unsqueeze(each[3], 1)};
      if (with_pose) columns.push_back(reshape(each[4], {count, kViewNumbers}));
      return concat(columns, 1);
    };
    return vjp_of(rows, in, g);
  }
  SplatLook look;
  bool with_pose;
};

/// in: means, scales, rotations, logits, views [N,3,4], lens [6], perhaps owners -> [G,7].
struct Project final : Op {
  explicit Project(const SplatLook& how) : look(how) {}
  const char* name() const override { return "splat_project"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 256);
    const Owners owners(in, 6, in.size());
    launch(kernel("splat_project", "project"), name(), range, in[0], in[1], in[2], in[3], in[4], owners.rows,
           owners.owned ? 1 : 0, in[5], out, out.dim(0), look.blur, look.near, look.antialiased ? 1 : 0, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    const int64_t count = in[0].dim(0);
    const bool pose = in[4].node()->tracked;
    Tensors all = in;
    all.push_back(g);
    const Tensor rows = make(std::make_shared<ProjectGrad>(look, pose), {count, pose ? 23 : 11}, all);
    Tensors gradients = {slice(rows, 1, 0, 3), slice(rows, 1, 3, 6), slice(rows, 1, 6, 10),
                         reshape(slice(rows, 1, 10, 11), {count})};
    gradients.resize(in.size());
    if (pose)
      gradients[4] = reshape(by_owner(slice(rows, 1, 11, 23), Owners(in, 6, in.size()), in[4].dim(0)), in[4].shape());
    return gradients;
  }
  SplatLook look;
};

/// in: rest, means, eyes [N,3], the colours found, perhaps owners, g -> [G,15,3] of rest, or [G,6] of first and means.
struct ColoursGrad final : Op {
  ColoursGrad(int used, bool rest) : bands(used), of_rest(rest) {}
  const char* name() const override { return of_rest ? "splat_colours_rest_grad" : "splat_colours_grad"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 256);
    const Owners owners(in, 4, in.size() - 1);
    const int owned = owners.owned ? 1 : 0;
    if (of_rest)
      launch(kernel("splat_project", "colours_rest_grad"), name(), range, in[1], in[2], owners.rows, owned, in[3],
             in.back(), out, out.dim(0), bands, chunk);
    else
      launch(kernel("splat_project", "colours_grad"), name(), range, in[0], in[1], in[2], owners.rows, owned, in[3],
             in.back(), out, out.dim(0), bands, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    const auto rows = [bands = bands, of_rest = of_rest](const Tensors& of) {
      const int64_t count = of[1].dim(0);
      const Tensor eyes = own_rows(of[2], Owners(of, 4, of.size() - 1), count);
      const Tensors own = {zeros({count, 3}), of[0], of[1], eyes};  // linear in the first
      const Tensors each = vjp_of([&](const Tensors& x) { return harmonic_sums_composed(x, bands); }, own,
                                  where(of[3] > 0.f, of.back(), 0.f));
      return of_rest ? each[1] : concat({each[0], each[2]}, 1);
    };
    return vjp_of(rows, in, g);
  }
  int bands;
  bool of_rest;
};

/// in: first, rest, means, eyes [N,3], perhaps owners -> [G,3].
struct Colours final : Op {
  explicit Colours(int used) : bands(used) {}
  const char* name() const override { return "splat_colours"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 256);
    const Owners owners(in, 4, in.size());
    launch(kernel("splat_project", "colours"), name(), range, in[0], in[1], in[2], in[3], owners.rows,
           owners.owned ? 1 : 0, out, out.dim(0), bands, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override {
    const int64_t count = in[0].dim(0);
    Tensors all = {in[1], in[2], in[3], out};
    all.insert(all.end(), in.begin() + 4, in.end());
    all.push_back(g);
    const Tensor rest = make(std::make_shared<ColoursGrad>(bands, true), in[1].shape(), all);
    const Tensor rows = make(std::make_shared<ColoursGrad>(bands, false), {count, 6}, all);
    const Tensor by_mean = slice(rows, 1, 3, 6);
    Tensors gradients = {slice(rows, 1, 0, 3), rest, by_mean};
    gradients.resize(in.size());
    if (in[3].node()->tracked) gradients[3] = -by_owner(by_mean, Owners(in, 4, in.size()), in[3].dim(0));
    return gradients;
  }
  int bands;
};

/// Their running sums are of 32 bits.
void check_pairs(const Tensor& counts, int64_t tiles) {
  constexpr int64_t kMost = std::numeric_limits<int32_t>::max();
  if (counts.numel() * tiles <= kMost) return;
  const float pairs = sum(cast(counts, DType::f32)).item();
  if (pairs >= 0.999f * static_cast<float>(kMost))
    throw Error(Fault::usage,
                text("[splat_tiles] ", counts.numel(), " gaussians reach ", pairs, " times into ", tiles,
                     " tiles, want fewer than 2^31\n  fix: fewer or smaller gaussians, a smaller picture"));
}

Tensor running_starts(const Tensor& counts) {
  const Tensor starts = empty(counts.shape(), DType::i32);
  scan_rows(counts, starts, 1, {.exclusive = true});
  return starts;
}

}  // namespace

Tensor splat_project(const Cloud& cloud, const Tensor& view, const SplatCamera& camera, const Tensor& owners) {
  match("splat_project", {{"means", cloud.means, "G 3"},
                          {"scales", cloud.scales, "G 3"},
                          {"rotations", cloud.rotations, "G 4"},
                          {"opacities", cloud.opacities, "G"},
                          {"view", view, owners ? "N 3 4" : "3 4"}});
  check_owners("splat_project", owners, cloud.means);
  const std::vector<float> lens = {
      camera.fx, camera.fy, camera.cx, camera.cy, static_cast<float>(camera.width), static_cast<float>(camera.height)};
  Tensors in = {cloud.means,
                cloud.scales,
                cloud.rotations,
                cloud.opacities,
                owners ? view : unsqueeze(view, 0),
                from_host(lens, {kLensNumbers})};
  if (owners) in.push_back(owners);
  return make(std::make_shared<Project>(SplatLook{camera.blur, camera.near, camera.antialiased}),
              {cloud.means.dim(0), kSeen}, in);
}

Tensor splat_colours(const Harmonics& harmonics, const Tensor& means, const Tensor& eye, const Tensor& owners) {
  match("splat_colours", {{"first", harmonics.first, "G 3"},
                          {"rest", harmonics.rest, "G 15 3"},
                          {"means", means, "G 3"},
                          {"eye", eye, owners ? "N 3" : "3"}});
  check_owners("splat_colours", owners, means);
  if (harmonics.degree < 0 || harmonics.degree > 3)
    throw Error(Fault::internal, text("[splat_colours] degree ", harmonics.degree, ", want 0 to 3"));
  Tensors in = {harmonics.first, harmonics.rest, means, owners ? eye : unsqueeze(eye, 0)};
  if (owners) in.push_back(owners);
  return make(std::make_shared<Colours>((harmonics.degree + 1) * (harmonics.degree + 1)), {means.dim(0), 3}, in);
}

SplatTiles splat_tiles(const Tensor& seen, int64_t height, int64_t width) {
  match("splat_tiles", {{"seen", seen, "G 7"}});
  const Tensor splats = dense(stop_gradient(seen));
  const int64_t count = splats.dim(0), across = (width + kTile - 1) / kTile, down = (height + kTile - 1) / kTile;
  const Tensor order = dense(sort(reshape(slice(splats, 1, 6, 7), {count})).order);  // read twice
  const auto [range, chunk] = chunks(count, 256);
  const Tensor counts = empty({count}, DType::i32);
  launch(kernel("splat_tiles", "count_tiles"), "count_tiles", range, splats, counts, count, across, down, chunk);
  check_pairs(counts, across * down);
  const auto starts_of = [&](const Tensor& of) { return running_starts(dense(pad(of, 0, 0, 1))); };
  const Tensor first = starts_of(counts), starts = starts_of(gather_rows(counts, order));
  const int64_t pairs = value_at(starts, count);
  const Tensor tiles = empty({pairs}, DType::i32), slots = empty({pairs}, DType::i32),
               owner = empty({pairs}, DType::i32);
  launch(kernel("splat_tiles", "list_tiles"), "list_tiles", range, splats, order, starts, first, tiles, slots, owner,
         count, across, down, chunk);
  const int bits = std::max(1, static_cast<int>(std::bit_width(static_cast<uint64_t>(across * down))));
  const Sorted by_tile = sort(tiles, bits, slots);
  return {gather_rows(owner, by_tile.order),
          segment_offsets(by_tile.keys, across * down),
          by_tile.order,
          first,
          height,
          width};
}

}  // namespace cloam
