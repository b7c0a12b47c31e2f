// The field of streets (UniSim, Yang et al. 2023; NeuRAD and GenAssets after it): what an encoding says of a point to a
// signed distance, and with the view to a feature that an image decoder turns to colour. Shared by actors and
// background.
#pragma once
#include <functional>
#include <optional>

#include "models/nn/layers.h"

namespace cloam {

struct StreetFieldOptions {
  int width = 64, distance_layers = 2, feature_layers = 3;
  int features = 32;     // and as many numbers, of which the distance is the first, between the two networks
  float sharpness = 20;  // beta at the start
  bool bypass = true;    // a linear map from the encoding past the first network
  bool residual = true;  // the second network adds to the first one's output; false: it replaces it
};

class StreetField {
 public:
  /// inputs: numbers that the encoding says of a point.
  StreetField(const Scope& scope, int64_t inputs, const StreetFieldOptions& options);
  struct Geometry {
    Tensor distance;  // [S] in metres' scale, negative inside
    Tensor inner;     // [S,features], the first as the distance, which costs less than leaving it out
  };
  /// encoded: [S,inputs].
  Geometry geometry(const Tensor& encoded) const;
  /// harmonics: [S,16] of the view's direction -> [S,features]. The second network adds what depends on the view; what
  /// does not goes past it, so that colours outlive the units that it loses.
  Tensor features(const Tensor& inner, const Tensor& harmonics) const;
  /// alpha = sigmoid(-beta s): [S]. No step length in it (UniSim).
  Tensor opacity(const Tensor& distance) const;

 private:
  StreetFieldOptions options_;
  SmallMlp distance_, feature_;
  std::optional<Linear>
      past_;  // to inner past the first network: a paint is learned by a line, long before units agree on it
  Tensor sharpness_;
};

/// The way outwards at points [S,3] of a field of distances, of length 1: by differences over the corners of a
/// tetrahedron.
Tensor outward_normals(const Tensor& points, const std::function<Tensor(const Tensor& points)>& distance);

}  // namespace cloam
