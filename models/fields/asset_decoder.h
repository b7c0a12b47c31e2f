// From an asset's latent code to its tri-planes (GenAssets, supplement A), after VQGAN's decoder (Esser et al. 2021).
#pragma once
#include <optional>
#include <vector>

#include "models/nn/image_layers.h"

namespace cloam {

struct AssetDecoderOptions {
  int64_t latent_channels = 32, side = 8;  // of codes
  int64_t classes = 8, class_channels = 32;
  int64_t middle = 256;                                   // width of the first two blocks and the attention
  std::vector<int64_t> widths = {256, 128, 128, 64, 64};  // of the blocks; before each but the first the image doubles
  int64_t plane_channels = 36;                            // three planes of 12
  int groups = 32;
  bool class_places = true;  // a class tells something of each place besides what it tells of all
  bool bypass = true;        // a linear path from codes to texels past the network
};

class AssetDecoder {
 public:
  explicit AssetDecoder(const Scope& scope, const AssetDecoderOptions& options = {});
  /// latent [N,latent_channels,side,side], class_id int32 [N] -> planes [N,plane_channels,16 side,16 side] (with four
  /// doublings).
  Tensor operator()(const Tensor& latent, const Tensor& class_id) const;

 private:
  AssetDecoderOptions options_;
  Tensor class_table_, class_places_;  // of a class, everywhere and place by place (empty: nothing)
  Conv2d enter_;
  ResBlock middle1_;
  AttentionBlock attention_;
  ResBlock middle2_;
  std::vector<ResBlock> stages_;
  GroupNorm last_norm_;
  Conv2d leave_;
  // Past all of it: what a code says of a place, and of the whole asset. Group norms take from codes what is alike
  // everywhere, so that a paint would have to be learned place by place, and sides that no camera saw have none. What
  // has been seen of a place is soon learned by a linear map, what all of a class have there too.
  std::optional<Conv2d> place_, whole_;
  int64_t fine_;  // texels a side that place_ tells of each place
};

}  // namespace cloam
