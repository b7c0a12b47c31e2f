// Capability: what it learned are 3D gaussians.
#pragma once
#include "models/gaussians/gaussians.h"

namespace cloam {

/// How the method's own pictures are drawn, for others to draw the same.
struct GaussianDrawing {
  double near = 0;           // scene units: gaussians whose centre is nearer are not seen
  bool antialiased = false;  // opacities shrink by what the pixel filter widens (Mip-Splatting)
  bool white = false;        // the background; else black
};

class ExportsGaussians {
 public:
  virtual ~ExportsGaussians() = default;
  virtual Gaussians gaussians() const = 0;
  virtual GaussianDrawing drawing() const = 0;
};

}  // namespace cloam
