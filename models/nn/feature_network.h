// Frozen convolutional networks whose feature maps say how alike two images look: pretrained ones from the user's file
// of weights, and fixed random features where there is none.
#pragma once
#include <filesystem>
#include <string>
#include <variant>
#include <vector>

#include "models/io/weights.h"
#include "runtime/ops.h"

namespace cloam {

constexpr int64_t kHalfKernel = -1;

/// ReLU(convolution + bias).
struct FeatureConvolution {
  Tensor weight, bias;  // [K,C,R,S], [K]
  int stride = 1;
  int64_t pad = kHalfKernel;  // zeros on each side of the image; half a kernel keeps the size at stride 1
  Tensor operator()(const Tensor& x) const;
};

/// The mean of the 3x3 places around each place, of those that are in the image.
struct NeighbourMean {
  Tensor operator()(const Tensor& x) const;
};

struct FeatureLayer;
/// Chains of layers side by side; the channels of their results are joined.
struct Branches {
  std::vector<std::vector<FeatureLayer>> chains;
  Tensor operator()(const Tensor& x) const;
};

struct FeatureLayer {
  std::string name = {};  // of the tap; empty: its result is only passed on
  std::variant<Pooling, FeatureConvolution, NeighbourMean, Branches> what = {};  // Pooling: the largest of each window
  Tensor operator()(const Tensor& x) const;
};

struct FeatureNetwork {
  std::string name;     // for reports: "squeezenet-1.0", "vgg-19", "random features", those of known_weights.h
  Tensor scale, shift;  // [1,3,1,1]: the layers see images * scale + shift
  std::vector<FeatureLayer> layers;
  std::vector<float> loss_weights;  // a tap (perceptual_loss); empty: no loss looks through it
  int64_t smallest;                 // height and width that an image must have
  int64_t side = 0;                 // images are first scaled to side x side (resize_tensorflow1); 0: they stay

  /// RGB images [N,3,H,W] in [0,1] -> the feature maps [N,C,h,w] of every tap, shallow to deep. Those that nobody reads
  /// cost nothing. Weights are no parameters: gradients reach the images alone.
  Tensors operator()(const Tensor& images) const;
};

/// The network that the file of weights holds (models/io/weights.h; docs/formats.md, "Weights of feature networks"); an
/// empty path gives the random features. Fault::data that names the tensors looked for and found.
FeatureNetwork feature_network(const std::filesystem::path& weights);
FeatureNetwork feature_network(const Weights& weights);
/// The one that --features names: a file of weights, or "random".
FeatureNetwork features_named(const std::string& features);
/// He-initialised 3x3 convolutions between poolings, the same numbers in every run.
FeatureNetwork random_features();

/// Sum over taps of weight * mean |features of rendered - features of truth|; both [N,3,H,W] in [0,1] -> one value.
/// pix2pixHD's form and, for VGG-19, its weights (Wang et al. 2018, from Johnson et al. 2016). The gradient reaches
/// `rendered` alone. Fault::usage for a network without weights of a loss.
Tensor perceptual_loss(const FeatureNetwork& network, const Tensor& rendered, const Tensor& truth);

}  // namespace cloam
