// Capability: what it learned are 3D gaussians.
#pragma once
#include "models/gaussians/gaussians.h"

namespace cloam {

class ExportsGaussians {
 public:
  virtual ~ExportsGaussians() = default;
  virtual Gaussians gaussians() const = 0;
};

}  // namespace cloam
