// The image decoder.
#include "models/nn/image_decoder.h"

namespace cloam {
namespace {

constexpr float kLeastSlope = 0.02f;

/// A sigmoid whose gradient is larger by kLeastSlope. The first steps move all colours at once, and in a street at
/// night they overshoot: where the sigmoid is flat by then, an image that went black would stay black.
Tensor learnable_sigmoid(const Tensor& x) { return sigmoid(x) + (x - stop_gradient(x)) * kLeastSlope; }

}  // namespace

ImageDecoder::ImageDecoder(const Scope& scope, const ImageDecoderOptions& o)
    : options_(o),
      enter_(scope / "enter", {o.features, o.width, o.side}),
      leave_(scope / "leave", {o.width, 3, o.side}) {
  for (int i = 0; i < o.blocks; i++) {
    const Scope here = scope / ("block" + std::to_string(i));
    blocks_.push_back({Conv2d(here / "first", {o.width, o.width, o.side}),
                       Conv2d(here / "second", {.in = o.width, .out = o.width, .side = o.side, .gain = 0.3f})});
  }
}

/// What goes into a convolution: rounded before the ReLU, so that the gradient of that, too, needs the halves alone.
Tensor ImageDecoder::kept(const Tensor& x) const { return options_.half ? cast(x, DType::f16) : x; }

Tensor ImageDecoder::operator()(const Tensor& features) const {
  Tensor h = enter_(kept(features));
  for (int i = 0; i < options_.blocks; i++) {
    const Block& block = blocks_[static_cast<size_t>(i)];
    h = h + block.second(relu(kept(block.first(relu(kept(h))))));
    if (i % 2 == 1 && i / 2 < options_.doublings) h = resize_nearest(h, 2 * h.dim(2), 2 * h.dim(3));
  }
  for (int i = options_.blocks / 2; i < options_.doublings; i++) h = resize_nearest(h, 2 * h.dim(2), 2 * h.dim(3));
  const Tensor drawn = leave_(relu(kept(h)));
  if (!options_.bypass) return learnable_sigmoid(drawn);
  const Tensor plain = resize_bilinear(slice(features, 1, 1, 4), h.dim(2), h.dim(3));
  return learnable_sigmoid(drawn + plain);
}

}  // namespace cloam
