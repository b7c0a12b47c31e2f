// Capability: shows what a camera would see.
#pragma once
#include "models/scene/view.h"

namespace cloam {

class RendersViews {
 public:
  virtual ~RendersViews() = default;
  virtual Picture render(const View& view) = 0;
};

}  // namespace cloam
