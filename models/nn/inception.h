// Inception of 2015-12-05, the network that FID and KID are defined by (Szegedy et al. 2016), as torch-fidelity reads
// it out of TensorFlow's graph.
#pragma once
#include "models/nn/feature_network.h"
#include "models/nn/known_weights.h"

namespace cloam {

constexpr char kInceptionFirst[] = "Conv2d_1a_3x3.conv";

/// Taps: the two poolings (64, 192 channels), Mixed_6e (768) and Mixed_7c, whose mean over places is the 2048 features.
/// Names as in the state of torch-fidelity's and pytorch-fid's module (docs/formats.md). Fault::data for tensors that
/// are missing or of another shape, and for torchvision's network, whose names are the same.
FeatureNetwork inception(const Weights& from);

/// TensorFlow 1's bilinear scaling of [N,C,H,W] to [N,C,side,side]: result i lies at i * size / side, not in between
/// pixels' centres as in resize_bilinear, and reads the two pixels around.
Tensor resize_tensorflow1(const Tensor& x, int64_t side);

}  // namespace cloam
