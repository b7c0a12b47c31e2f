// Capability: can keep in half precision what its convolutions read (train --precision mixed). Their sums, and all
// gradients and parameters, are floats.
#pragma once

namespace cloam {

/// Such a method's setting that says whether it does. Not for users to set: it follows from --precision.
constexpr char kMixedPrecision[] = "precision.mixed";

class MixedPrecision {
 public:
  virtual ~MixedPrecision() = default;
};

}  // namespace cloam
