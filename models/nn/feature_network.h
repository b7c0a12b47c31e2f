// Frozen convolutional networks whose feature maps say how alike two images look: pretrained ones from the user's file
// of weights, and fixed random features where there is none.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "runtime/ops.h"

namespace cloam {

/// ReLU(convolution); a fire module (Iandola et al. 2016: 1x1, then 1x1 and 3x3 side by side, each with ReLU); or max
/// pooling.
struct FeatureLayer {
  struct Convolution {
    Tensor weight, bias;
    Conv2dParams with;
  };
  std::string name;                       // of the tap; empty: its result is only passed on
  std::vector<Convolution> convolutions;  // none: pooling; one; three: fire
  Pooling pooling = {};
  Tensor operator()(const Tensor& x) const;
};

struct FeatureNetwork {
  std::string name;     // for reports: "squeezenet-1.0", "vgg-19", "random features"
  Tensor scale, shift;  // [1,3,1,1]: the layers see images * scale + shift
  std::vector<FeatureLayer> layers;
  std::vector<float> loss_weights;  // a tap (perceptual_loss)
  int64_t smallest;                 // height and width that an image must have

  /// RGB images [N,3,H,W] in [0,1] -> the feature maps [N,C,h,w] of every tap, shallow to deep. Those that nobody reads
  /// cost nothing. Weights are no parameters: gradients reach the images alone.
  Tensors operator()(const Tensor& images) const;
};

/// The network that the file of weights holds (models/io/weights.h; docs/formats.md, "Weights of feature networks"); an
/// empty path gives the random features. Fault::data that names the tensors looked for and found.
FeatureNetwork feature_network(const std::filesystem::path& weights);
/// He-initialised 3x3 convolutions between poolings, the same numbers in every run.
FeatureNetwork random_features();

/// Sum over taps of weight * mean |features of rendered - features of truth|; both [N,3,H,W] in [0,1] -> one value.
/// pix2pixHD's form and, for VGG-19, its weights (Wang et al. 2018, from Johnson et al. 2016). The gradient reaches
/// `rendered` alone.
Tensor perceptual_loss(const FeatureNetwork& network, const Tensor& rendered, const Tensor& truth);

}  // namespace cloam
