// Blending of 2D Gaussians, tile by tile.
#include "runtime/ops/splat.h"

#include <algorithm>
#include <bit>

#include "runtime/cl.h"
#include "runtime/ops/composed.h"
#include "runtime/ops/share.h"
#include "runtime/ops/splat_composed.h"

namespace cloam {
namespace {

const Registered kSplatKernels("splat_blend");

constexpr int64_t kPair = 16, kProbe = 2;  // numbers of a pair's gradient, those of them that are the probe's
constexpr int kMore = 2;                   // channels that a pass may have beside three

/// For the kernels: the channels of colours [G,3] or [G,5] beside three.
Constants channels_of(const Tensor& colours, Constants others = {}) {
  others.emplace_back("MORE", static_cast<int>(colours.dim(1)) - 3);
  return others;
}

/// The gaussians' numbers side by side, as the kernels of CPU devices read them.
Tensor records_of(const Variant& variant, const Tensors& in) {
  const int64_t count = in[0].dim(0);
  const Tensor records = empty({count, 16});
  const WorkShare work = share(count, 1024);
  if (count > 0)
    launch(kernel(variant, "splat_records", channels_of(in[1])), "splat_records", work.range, in[0], in[1], records,
           count, work.chunk);
  return records;
}

/// A group a tile in the GPU variant, else a work-item each of `items`.
Range tiled_range(const Variant& v, int64_t tiles, int64_t items, int64_t together) {
  return v.where == "gpu" ? range1(tiles * v["LANES"], v["LANES"]) : range1(items, together);
}

/// in: splats, colours, ids, offsets, slots, the picture, its gradient -> [P,16], as kernels/splat.cl says.
struct SplatGrad final : Op {
  SplatGrad(const SplatPicture& of, bool probed) : picture(of), with_probe(probed) {}
  const char* name() const override { return "splat_blend_grad"; }
  void run(const Tensors& in, Tensor& out) const override {
    if (out.numel() == 0) return;
    const Variant& variant = choose("splat", "gradient");
    const char* const what = variant.kernel.c_str();
    const int64_t tiles = picture.tiles();
    if (variant.where == "cpu")
      launch(kernel(variant, channels_of(in[1], {{"PROBE", with_probe ? 1 : 0}})), what, range1(tiles),
             records_of(variant, in), in[2], in[3], in[4], in[5], in[6], out, picture.height, picture.width);
    else
      launch(kernel(variant, channels_of(in[1])), what, tiled_range(variant, tiles, tiles, 1), in[0], in[1], in[2],
             in[3], in[4], in[5], in[6], out, picture.height, picture.width);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    const auto rows = [picture = picture](const Tensors& of) {
      const Tensors own = {gather_rows(of[0], of[2]), gather_rows(of[1], of[2]), of[3]};
      const Tensors each = vjp_of([&](const Tensors& x) { return blend_composed(x, picture); }, own, of[6]);
      Tensors row = {each[0], slice(each[1], 1, 0, 3)};
      if (of[1].dim(1) > 3) row = {row[0], row[1], zeros({of[2].dim(0), kProbe}), slice(each[1], 1, 3, of[1].dim(1))};
      const Tensor numbers = concat(row, 1);
      return scatter_add_rows(pad(numbers, 1, 0, kPair - numbers.dim(1)), of[4], of[4].dim(0));
    };
    return vjp_of(rows, in, g);
  }
  SplatPicture picture;
  bool with_probe;
};

/// in: splats, colours, the probe, ids, offsets, slots, first -> [4,H,W], or [6,H,W] for five channels; T last.
struct SplatBlend final : Op {
  explicit SplatBlend(const SplatPicture& of) : picture(of) {}
  const char* name() const override { return "splat_blend"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override;
  SplatPicture picture;
};

void SplatBlend::run(const Tensors& in, Tensor& out) const {
  if (out.numel() == 0) return;
  const Variant& variant = choose("splat", "forward");
  const char* const what = variant.kernel.c_str();
  const int64_t tiles = picture.tiles();
  if (variant.where == "cpu")
    launch(kernel(variant, channels_of(in[1])), what, range1(tiles), records_of(variant, in), in[3], in[4], out,
           picture.height, picture.width);
  else
    launch(kernel(variant, channels_of(in[1])), what, tiled_range(variant, tiles, picture.height * picture.width, 64),
           in[0], in[1], in[3], in[4], out, picture.height, picture.width);
}

Tensors SplatBlend::vjp(const Tensors& in, const Tensor& out, const Tensor& g) const {
  const Tensor pairs = make(std::make_shared<SplatGrad>(picture, in[2].tracked()), {in[3].dim(0), kPair},
                            {in[0], in[1], in[3], in[4], in[5], out, g});
  const Tensor sums = segment_sum(pairs, in[6]);
  Tensor colours = slice(sums, 1, 7, 10);
  if (const int64_t more = in[1].dim(1) - 3; more > 0) colours = concat({colours, slice(sums, 1, 12, 12 + more)}, 1);
  return {slice(sums, 1, 0, 7), colours, slice(sums, 1, 10, 12), Tensor(), Tensor(), Tensor(), Tensor()};
}

/// Three or five channels.
Tensor blend_pass(const Splats& splats, const Tensor& colours, const SplatTiles& tiles) {
  const Tensor probe = splats.probe ? splats.probe : zeros({splats.seen.dim(0), 2});
  return make(std::make_shared<SplatBlend>(SplatPicture{tiles.height, tiles.width}),
              {colours.dim(1) + 1, tiles.height, tiles.width},
              {splats.seen, colours, probe, tiles.ids, tiles.offsets, tiles.slots, tiles.first});
}

void check_tiles(const Splats& splats, const SplatTiles& tiles) {
  const SplatPicture picture{tiles.height, tiles.width};
  match("splat_blend", {{"seen", splats.seen, "G V"},
                        {"colours", splats.colours, "G C"},
                        {"ids", tiles.ids, "P"},
                        {"slots", tiles.slots, "P"},
                        {"offsets", tiles.offsets, "T"}});
  if (splats.seen.dim(1) != 7 || splats.colours.dim(1) < 1)
    throw Error(Fault::internal, text("[splat_blend] seen ", to_string(splats.seen.shape()), ", colours ",
                                      to_string(splats.colours.shape()), ": want [G,7] and [G,1] or more"));
  const auto integers = [](const Tensor& x) { return x.dtype() == DType::i32; };
  if (picture.height < 0 || picture.width < 0 || tiles.offsets.dim(0) != picture.tiles() + 1 ||
      tiles.first.numel() != splats.seen.dim(0) + 1 || !integers(tiles.ids) || !integers(tiles.offsets) ||
      !integers(tiles.slots) || !integers(tiles.first))
    throw Error(Fault::internal,
                text("[splat_blend] ids ", name_of(tiles.ids.dtype()), ", offsets ", to_string(tiles.offsets.shape()),
                     " ", name_of(tiles.offsets.dtype()), ", first ", to_string(tiles.first.shape()), " for ",
                     picture.height, " x ", picture.width, " pixels: want int32, offsets [", picture.tiles() + 1,
                     "] for tiles of 16 x 16, and first [", splats.seen.dim(0) + 1, "]"));
}

}  // namespace

Blended splat_blend(const Splats& splats, const SplatTiles& tiles) {
  check_tiles(splats, tiles);
  const int64_t channels = splats.colours.dim(1);
  Tensors parts;
  Tensor transmittance;
  for (int64_t c = 0; c < channels;) {
    const int64_t pass = channels - c > 3 ? 3 + kMore : 3, here = std::min(pass, channels - c);
    const Tensor some = slice(splats.colours, 1, c, c + here);
    const Tensor planes = blend_pass(splats, here == pass ? some : pad(some, 1, 0, pass - here), tiles);
    parts.push_back(slice(planes, 0, 0, here));
    if (!transmittance) transmittance = reshape(slice(planes, 0, pass, pass + 1), {tiles.height, tiles.width});
    c += here;
  }
  return {permute(parts.size() == 1 ? parts.front() : concat(parts, 0), {1, 2, 0}), transmittance};
}

SplatTiles splat_lists(const Tensor& ids, const Tensor& offsets, const SplatExtent& extent) {
  const int bits = std::max(1, static_cast<int>(std::bit_width(static_cast<uint64_t>(extent.gaussians))));
  const Sorted by_gaussian = sort(ids, bits);
  return {
      ids,           offsets,     sort(by_gaussian.order).order, segment_offsets(by_gaussian.keys, extent.gaussians),
      extent.height, extent.width};
}

}  // namespace cloam
