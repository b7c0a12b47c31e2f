// Capability: a radiance field, which can be asked at any place of the world.
#pragma once
#include <Eigen/Geometry>
#include <functional>
#include <vector>

namespace cloam {

/// Points and directions [N,3] in the capture's world. Valid as long as the method that gave it stands still.
struct DensityField {
  Eigen::AlignedBox3d subject;  // where most photos look
  /// [N] per scene unit: what light loses, as pictures have it (none where they take no samples).
  std::function<std::vector<float>(const std::vector<float>& points)> densities;
  /// [N,3] in [0,1], seen along directions of length 1.
  std::function<std::vector<float>(const std::vector<float>& points, const std::vector<float>& directions)> colours;
  /// Whether it is known that all densities in the box are 0.
  std::function<bool(const Eigen::AlignedBox3d& box)> is_empty;
};

class HasDensity {
 public:
  virtual ~HasDensity() = default;
  /// Fault::usage where the space is one that has no such places (NDC).
  virtual DensityField density_field() const = 0;
};

}  // namespace cloam
