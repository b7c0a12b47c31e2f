// LPIPS v0.1 (Zhang et al. 2018): how different two images look, by features of AlexNet or VGG-16 and learned weights
// of their channels.
#pragma once
#include <string>

#include "models/nn/feature_network.h"
#include "models/nn/known_weights.h"

namespace cloam {

struct Lpips {
  std::string name;  // for reports: kLpipsAlex or kLpipsVgg if both files are the published ones
  FeatureNetwork network;
  Tensors weights;  // a tap, [1,C,1,1], none below 0

  /// Features scaled to length 1 over the channels of each place, squared difference, weighted sum over channels, mean
  /// over places, sum over taps: a, b [N,3,H,W] in [0,1] -> [N].
  Tensor operator()(const Tensor& a, const Tensor& b) const;
  /// Are both files the published ones, so that its values are LPIPS?
  bool published() const;
};

/// The key of its figures in reports by its name: "lpips" of the published weights, else "perceptual_distance".
std::string lpips_key(const std::string& name);

/// The backbone has torchvision's names (models/nn/feature_network.h), the linear layers PerceptualSimilarity's,
/// lin0.model.1.weight [1,C,1,1] to lin4. Fault::data that says what was looked for and what was found.
Lpips lpips(const Weights& backbone, const Weights& linear);
/// The one that --lpips names: "BACKBONE,LINEAR", two files, or one file that holds both.
Lpips lpips_named(const std::string& files);

}  // namespace cloam
