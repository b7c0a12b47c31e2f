// Capability: the focal lengths of its cameras change while it learns.
#pragma once
#include <vector>

namespace cloam {

class RefinesIntrinsics {
 public:
  virtual ~RefinesIntrinsics() = default;
  /// Of Scene::cameras, the focal lengths that were learned over those given (with_focal of models/scene/camera.h);
  /// empty where the settings leave them as they are.
  virtual std::vector<double> focal_factors() const = 0;
};

}  // namespace cloam
