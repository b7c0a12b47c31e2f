// 3D Gaussians as a camera sees them: projection, colours, and the tiles that they reach.
#include <bit>
#include <limits>

#include "runtime/cl.h"
#include "runtime/ops/composed.h"
#include "runtime/ops/scan.h"
#include "runtime/ops/splat_composed.h"

namespace cloam {
namespace {

const Registered kSplatProjectKernels[] = {Registered("splat_project"), Registered("splat_colours")};

constexpr int64_t kSeen = 7, kTile = 16, kCameraNumbers = 18;

/// in: means, scales, rotations, logits, camera [18], g -> [G,11], or [G,23] with the pose's part.
struct ProjectGrad final : Op {
  ProjectGrad(const SplatLook& how, bool pose) : look(how), with_pose(pose) {}
  const char* name() const override { return "splat_project_grad"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 256);
    launch(kernel("splat_project", "project_grad"), name(), range, in[0], in[1], in[2], in[3], in[4], in[5], out,
           out.dim(0), look.blur, look.near, look.antialiased ? 1 : 0, with_pose ? 1 : 0, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    const auto rows = [look = look, with_pose = with_pose](const Tensors& of) {
      const int64_t count = of[0].dim(0);
      const Tensor view = reshape(slice(of[4], 0, 0, 12), {1, 3, 4}), lens = slice(of[4], 0, 12, kCameraNumbers);
      const Tensors own = {of[0], of[1], of[2], of[3], broadcast_to(view, {count, 3, 4}), lens};
      const Tensors each = vjp_of([&](const Tensors& x) { return project_composed(x, look); }, own, of[5]);
      Tensors columns = {each[0], each[1], each[2], unsqueeze(each[3], 1)};
      if (with_pose) columns.push_back(reshape(each[4], {count, 12}));
      return concat(columns, 1);
    };
    return vjp_of(rows, in, g);
  }
  SplatLook look;
  bool with_pose;
};

/// in: means, scales, rotations, logits, camera [18] -> [G,7].
struct Project final : Op {
  explicit Project(const SplatLook& how) : look(how) {}
  const char* name() const override { return "splat_project"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 256);
    launch(kernel("splat_project", "project"), name(), range, in[0], in[1], in[2], in[3], in[4], out, out.dim(0),
           look.blur, look.near, look.antialiased ? 1 : 0, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    const int64_t count = in[0].dim(0);
    const bool pose = in[4].node()->tracked;
    Tensors all = in;
    all.push_back(g);
    const Tensor rows = make(std::make_shared<ProjectGrad>(look, pose), {count, pose ? 23 : 11}, all);
    const Tensor camera = pose ? pad(sum(slice(rows, 1, 11, 23), {.axes = {0}}), 0, 0, kCameraNumbers - 12) : Tensor();
    return {slice(rows, 1, 0, 3), slice(rows, 1, 3, 6), slice(rows, 1, 6, 10), reshape(slice(rows, 1, 10, 11), {count}),
            camera};
  }
  SplatLook look;
};

/// in: rest, means, eye, the colours found, g -> [G,51].
struct ColoursGrad final : Op {
  explicit ColoursGrad(int used) : bands(used) {}
  const char* name() const override { return "splat_colours_grad"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 256);
    launch(kernel("splat_project", "colours_grad"), name(), range, in[0], in[1], in[2], in[3], in[4], out, out.dim(0),
           bands, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    const auto rows = [bands = bands](const Tensors& of) {
      const int64_t count = of[1].dim(0);
      const Tensors own = {zeros({count, 3}), of[0], of[1], of[2]};  // linear in the first
      const Tensors each = vjp_of([&](const Tensors& x) { return harmonic_sums_composed(x, bands); }, own,
                                  where(of[3] > 0.f, of[4], 0.f));
      return concat({each[0], reshape(each[1], {count, 45}), each[2]}, 1);
    };
    return vjp_of(rows, in, g);
  }
  int bands;
};

/// in: first, rest, means, eye -> [G,3].
struct Colours final : Op {
  explicit Colours(int used) : bands(used) {}
  const char* name() const override { return "splat_colours"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 256);
    launch(kernel("splat_project", "colours"), name(), range, in[0], in[1], in[2], in[3], out, out.dim(0), bands,
           chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override {
    const int64_t count = in[0].dim(0);
    const Tensor rows = make(std::make_shared<ColoursGrad>(bands), {count, 51}, {in[1], in[2], in[3], out, g});
    const Tensor by_mean = slice(rows, 1, 48, 51);
    return {slice(rows, 1, 0, 3), reshape(slice(rows, 1, 3, 48), {count, 15, 3}), by_mean,
            -sum(by_mean, {.axes = {0}})};
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

Tensor splat_project(const Cloud& cloud, const Tensor& view, const SplatCamera& camera) {
  match("splat_project", {{"means", cloud.means, "G 3"},
                          {"scales", cloud.scales, "G 3"},
                          {"rotations", cloud.rotations, "G 4"},
                          {"opacities", cloud.opacities, "G"},
                          {"view", view, "3 4"}});
  const std::vector<float> lens = {
      camera.fx, camera.fy, camera.cx, camera.cy, static_cast<float>(camera.width), static_cast<float>(camera.height)};
  const Tensor numbers = concat({reshape(view, {12}), from_host(lens, {kCameraNumbers - 12})}, 0);
  return make(std::make_shared<Project>(SplatLook{camera.blur, camera.near, camera.antialiased}),
              {cloud.means.dim(0), kSeen}, {cloud.means, cloud.scales, cloud.rotations, cloud.opacities, numbers});
}

Tensor splat_colours(const Harmonics& harmonics, const Tensor& means, const Tensor& eye) {
  match("splat_colours", {{"first", harmonics.first, "G 3"},
                          {"rest", harmonics.rest, "G 15 3"},
                          {"means", means, "G 3"},
                          {"eye", eye, "3"}});
  if (harmonics.degree < 0 || harmonics.degree > 3)
    throw Error(Fault::internal, text("[splat_colours] degree ", harmonics.degree, ", want 0 to 3"));
  return make(std::make_shared<Colours>((harmonics.degree + 1) * (harmonics.degree + 1)), {means.dim(0), 3},
              {harmonics.first, harmonics.rest, means, eye});
}

SplatTiles splat_tiles(const Tensor& seen, int64_t height, int64_t width) {
  match("splat_tiles", {{"seen", seen, "G 7"}});
  const Tensor splats = dense(stop_gradient(seen));
  const int64_t count = splats.dim(0), across = (width + kTile - 1) / kTile, down = (height + kTile - 1) / kTile;
  const Tensor order = sort(reshape(slice(splats, 1, 6, 7), {count})).order;
  const auto [range, chunk] = chunks(count, 256);
  const Tensor counts = empty({count}, DType::i32);
  launch(kernel("splat_tiles", "count_tiles"), "count_tiles", range, splats, counts, count, across, down, chunk);
  check_pairs(counts, across * down);
  const auto starts_of = [&](const Tensor& of) { return running_starts(dense(pad(of, 0, 0, 1))); };
  const Tensor first = starts_of(counts), starts = starts_of(gather_rows(counts, order));
  const int64_t pairs = value_at(starts, count);
  const Tensor tiles = empty({pairs}, DType::i32), slots = empty({pairs}, DType::i32),
               owner = empty({pairs}, DType::i32);
  launch(kernel("splat_tiles", "list_tiles"), "list_tiles", range, splats, dense(order), starts, first, tiles, slots,
         owner, count, across, down, chunk);
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
