// The asset decoder.
#include "models/fields/asset_decoder.h"

#include <algorithm>
#include <cmath>

#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {

namespace {

constexpr int64_t kFinest = 4;  // texels a side of a place

int64_t fine_of(const AssetDecoderOptions& o) { return std::min(kFinest, int64_t{1} << (o.widths.size() - 1)); }

/// [N, C f f, H, W] -> [N, C, f H, f W]: each place becomes f x f (Shi et al. 2016, sub-pixel convolution).
Tensor spread(const Tensor& x, int64_t f) {
  const int64_t n = x.dim(0), c = x.dim(1) / (f * f), h = x.dim(2), w = x.dim(3);
  return reshape(permute(reshape(x, {n, c, f, f, h, w}), {0, 1, 4, 2, 5, 3}), {n, c, f * h, f * w});
}

}  // namespace

AssetDecoder::AssetDecoder(const Scope& scope, const AssetDecoderOptions& o)
    : options_(o),
      class_table_(scope.uniform("class", {o.classes, o.class_channels}, std::sqrt(3.f))),  // variance 1
      enter_(scope / "enter", {o.latent_channels + o.class_channels, o.middle}),
      middle1_(scope / "middle.block0", {o.middle, o.middle, o.groups}),
      attention_(scope / "middle.attention", {o.middle, o.groups}),
      middle2_(scope / "middle.block1", {o.middle, o.middle, o.groups}),
      last_norm_(scope / "last_norm", o.widths.back(), o.groups),
      leave_(scope / "leave", {o.widths.back(), o.plane_channels}),
      fine_(fine_of(o)) {
  if (o.class_places)
    class_places_ = scope.constant("class_places", {o.classes, o.class_channels * o.side * o.side}, 0.f);
  if (o.bypass) {
    const int64_t of_class = o.class_places ? o.class_channels : 0;
    place_.emplace(scope / "past.place",
                   ConvShape{o.latent_channels + of_class, o.plane_channels * fine_of(o) * fine_of(o), 1});
    whole_.emplace(scope / "past.whole", ConvShape{o.latent_channels, o.plane_channels, 1});
  }
  int64_t width = o.middle;
  for (size_t i = 0; i < o.widths.size(); i++) {
    ResBlockShape shape = {width, o.widths[i], o.groups};
    shape.doubles = i > 0;
    stages_.emplace_back(scope / ("stage" + std::to_string(i)), shape);
    width = o.widths[i];
  }
}

Tensor AssetDecoder::operator()(const Tensor& latent, const Tensor& class_id) const {
  const Dims d = match("asset_decoder", {{"latent", latent, "N C H W"}, {"class_id", class_id, "N"}});
  if (d["C"] != options_.latent_channels)
    throw Error(Fault::internal, text("[asset_decoder] latent is ", to_string(latent.shape()), ", want [N, ",
                                      options_.latent_channels, ", H, W]"));
  const int64_t of = options_.class_channels;
  Tensor of_class = broadcast_to(reshape(gather_rows(class_table_, class_id), {d["N"], of, 1, 1}),
                                 {d["N"], of, d["H"], d["W"]}),
         of_place;
  if (class_places_) {
    of_place = reshape(gather_rows(class_places_, class_id), {d["N"], of, d["H"], d["W"]});
    of_class = of_class + of_place;
  }
  Tensor h = middle1_(enter_(concat({latent, of_class}, 1)));
  h = middle2_(attention_(h));
  for (const ResBlock& stage : stages_) h = stage(h);
  const Tensor planes = leave_(last_norm_.then_silu(h));
  if (!place_) return planes;
  const Tensor past = spread((*place_)(of_place ? concat({latent, of_place}, 1) : latent), fine_) +
                      (*whole_)(mean(latent, {{2, 3}, true}));
  return planes + resize_bilinear(past, planes.dim(2), planes.dim(3));
}

}  // namespace cloam
