// From a map of features to an image (GenAssets, supplement A: f_rgb): residual blocks, with the map doubled on the
// way. Three features go past them to the image (as in GIRAFFE, Niemeyer and Geiger 2021), so that colours learn at
// once and survive units that die: not the first, which of a street's field is the distance.
#pragma once
#include "models/nn/image_layers.h"

namespace cloam {

struct ImageDecoderOptions {
  int features = 32, width = 32;
  int side = 5;        // of the kernels
  int blocks = 6;      // residual blocks
  bool bypass = true;  // three features go past all of it to the image
  bool half = false;   // what the convolutions read is kept in half precision
  int doublings = 2;   // one after every second block, first to last; those left over after the last
};

class ImageDecoder {
 public:
  ImageDecoder(const Scope& scope, const ImageDecoderOptions& options);
  /// [N,features,H,W] -> RGB [N,3,H scale,W scale] in (0,1). Gradients reach pixels that are black or white, too.
  Tensor operator()(const Tensor& features) const;
  /// How much larger the image is than the map: 2^doublings.
  int scale() const { return 1 << options_.doublings; }

 private:
  Tensor kept(const Tensor& x) const;
  struct Block {
    Conv2d first, second;
  };
  ImageDecoderOptions options_;
  Conv2d enter_;
  std::vector<Block> blocks_;
  Conv2d leave_;
};

}  // namespace cloam
