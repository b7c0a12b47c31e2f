// Capability: parameters have as many rows as a checkpoint has of them.
#pragma once
#include "models/io/safetensors.h"

namespace cloam {

class TakesShapes {
 public:
  virtual ~TakesShapes() = default;
  /// Before a checkpoint's parameters are put in: takes their shapes from it.
  virtual void fit_to(const TensorMap& parameters) = 0;
};

}  // namespace cloam
