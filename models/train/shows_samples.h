// Capability: shows where along its rays a method samples.
#pragma once
#include <vector>

#include "models/scene/view.h"

namespace cloam {

struct RaySample {
  int column = 0;      // of the ray's pixel
  float distance = 0;  // from the camera, in the capture's units
  float weight = 0;    // the part of the ray's light that comes from here: alpha times transmittance
};

class ShowsSamples {
 public:
  virtual ~ShowsSamples() = default;
  /// What is shaded for a picture of the view along the rays of one row of pixels, from 0 at the top.
  virtual std::vector<RaySample> samples(const View& view, int row) = 0;
};

}  // namespace cloam
