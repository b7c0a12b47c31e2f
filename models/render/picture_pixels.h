// Pixels of rendered rays.
#pragma once
#include <vector>

#include "models/scene/view.h"

namespace cloam {

/// How rays' values become pixels.
struct PixelForm {
  size_t numbers;  // of a ray: colour times opacity, opacity, depth times opacity in normalised units, others
  float back;      // how bright it is where nothing is
  double scale;    // of normalised units
};
void append_pixels(Picture& picture, const std::vector<float>& values, const PixelForm& form);
/// A picture of half the size each way: means over 2 x 2 pixels, depths weighted by opacity.
Picture halved(const Picture& picture);

}  // namespace cloam
