// The field of streets (GenAssets, supplement A; UniSim, Yang et al. 2023): tri-plane features to a signed distance,
// and with the view to a feature that an image decoder turns to colour. Shared by actors and background.
#pragma once
#include <optional>

#include "models/nn/layers.h"

namespace cloam {

struct StreetFieldOptions {
  int plane_channels = 12;
  int width = 64, distance_layers = 2, feature_layers = 3;
  int features = 32;     // and as many numbers, of which the distance is the first, between the two networks
  float sharpness = 20;  // beta at the start
  bool bypass = true;    // a linear map from texels past the first network
  bool residual = true;  // the second network adds to the first one's output; false: it replaces it
};

class StreetField {
 public:
  StreetField(const Scope& scope, const StreetFieldOptions& options);
  struct Geometry {
    Tensor distance;  // [S] in metres' scale, negative inside
    Tensor inner;     // [S,features], the first as the distance, which costs less than leaving it out
  };
  /// planes: [S,3 plane_channels] of sample_planes.
  Geometry geometry(const Tensor& planes) const;
  /// harmonics: [S,16] of the view's direction -> [S,features]. The second network adds what depends on the view; what
  /// does not goes past it, so that colours outlive the units that it loses.
  Tensor features(const Tensor& inner, const Tensor& harmonics) const;
  /// alpha = sigmoid(-beta s): [S]. No step length in it (UniSim).
  Tensor opacity(const Tensor& distance) const;

 private:
  StreetFieldOptions options_;
  SmallMlp distance_, feature_;
  std::optional<Linear>
      past_;  // texels to inner past the first network: a paint is learned by a line, long before units agree on it
  Tensor sharpness_;
};

}  // namespace cloam
