// Blending of 2D Gaussians, tile by tile.
#include "runtime/cl.h"
#include "runtime/ops.h"
#include "runtime/ops/share.h"

namespace cloam {
namespace {

const Registered kRegistered("splat_blend");

constexpr int64_t kTile = 16;

struct Picture {
  int64_t height, width;
  int64_t tiles() const { return (height + kTile - 1) / kTile * ((width + kTile - 1) / kTile); }
};

/// The gaussians' numbers side by side, as the kernels of CPU devices read them.
Tensor records_of(const Variant& variant, const Tensors& in) {
  const int64_t count = in[0].dim(0);
  const Tensor records = empty({count, 16});
  const Share work = share(count, 1024);
  if (count > 0)
    launch(kernel(variant.stem.c_str(), "splat_records", variant.constants), "splat_records", work.range, in[0], in[1],
           in[2], in[3], records, count, work.chunk);
  return records;
}

/// in: means, conics, colours, opacities, ids, offsets, the picture, its gradient -> [P,9], as kernels/splat.cl says.
struct SplatGrad final : Op {
  explicit SplatGrad(const Picture& of) : picture(of) {}
  const char* name() const override { return "splat_blend_grad"; }
  void run(const Tensors& in, Tensor& out) const override {
    if (out.numel() == 0) return;
    const Variant& variant = choose("splat", "gradient");
    const char* const what = variant.kernel.c_str();
    const int64_t tiles = picture.tiles();
    if (variant.where == "cpu")
      launch(kernel(variant), what, range1(tiles), records_of(variant, in), in[4], in[5], in[6], in[7], out,
             picture.height, picture.width);
    else
      launch(kernel(variant), what, variant.where == "gpu" ? range1(tiles * 256, 256) : range1(tiles, 1), in[0], in[1],
             in[2], in[3], in[4], in[5], in[6], in[7], out, picture.height, picture.width);
  }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override {
    no_gradient("splat_blend", "it is once differentiable");
  }
  Picture picture;
};

struct SplatBlend final : Op {
  explicit SplatBlend(const Picture& of) : picture(of) {}
  const char* name() const override { return "splat_blend"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override;
  Picture picture;
};

void SplatBlend::run(const Tensors& in, Tensor& out) const {
  if (out.numel() == 0) return;
  const Variant& variant = choose("splat", "forward");
  const char* const what = variant.kernel.c_str();
  const int64_t tiles = picture.tiles();
  if (variant.where == "cpu")
    launch(kernel(variant), what, range1(tiles), records_of(variant, in), in[4], in[5], out, picture.height,
           picture.width);
  else
    launch(kernel(variant), what,
           variant.where == "gpu" ? range1(tiles * 256, 256) : range1(picture.height * picture.width, 64), in[0], in[1],
           in[2], in[3], in[4], in[5], out, picture.height, picture.width);
}

Tensors SplatBlend::vjp(const Tensors& in, const Tensor& out, const Tensor& g) const {
  Tensors all = in;
  all.insert(all.end(), {out, g});
  const Tensor pairs = make(std::make_shared<SplatGrad>(picture), {in[4].dim(0), 9}, all);
  const int64_t count = in[0].dim(0);
  const Tensor sums = count > 0 ? scatter_add_rows(pairs, in[4], count) : zeros({0, 9});
  return {slice(sums, 1, 0, 2),
          slice(sums, 1, 2, 5),
          slice(sums, 1, 5, 8),
          reshape(slice(sums, 1, 8, 9), {count}),
          Tensor(),
          Tensor()};
}

}  // namespace

Blended splat_blend(const Splats& splats, const SplatTiles& tiles) {
  const Picture picture{tiles.height, tiles.width};
  match("splat_blend", {{"means", splats.means, "G 2"},
                        {"conics", splats.conics, "G 3"},
                        {"colours", splats.colours, "G 3"},
                        {"opacities", splats.opacities, "G"},
                        {"ids", tiles.ids, "P"},
                        {"offsets", tiles.offsets, "T"}});
  if (picture.height < 0 || picture.width < 0 || tiles.offsets.dim(0) != picture.tiles() + 1 ||
      tiles.ids.dtype() != DType::i32 || tiles.offsets.dtype() != DType::i32)
    throw Error(Fault::internal,
                text("[splat_blend] ids ", name_of(tiles.ids.dtype()), ", offsets ", to_string(tiles.offsets.shape()),
                     " ", name_of(tiles.offsets.dtype()), " for ", picture.height, " x ", picture.width,
                     " pixels: want int32, and offsets [", picture.tiles() + 1, "] for tiles of 16 x 16"));
  const Tensor planes = make(std::make_shared<SplatBlend>(picture), {4, picture.height, picture.width},
                             {splats.means, splats.conics, splats.colours, splats.opacities, tiles.ids, tiles.offsets});
  return {permute(slice(planes, 0, 0, 3), {1, 2, 0}), reshape(slice(planes, 0, 3, 4), {picture.height, picture.width})};
}

}  // namespace cloam
