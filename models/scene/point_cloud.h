// Coloured points that came with a capture: what structure from motion found, or a LiDAR.
#pragma once
#include <cstdint>
#include <vector>

namespace cloam {

struct PointCloud {
  std::vector<float> positions;       // [P,3], world frame, scene units
  std::vector<std::uint8_t> colours;  // [P,3] RGB

  std::size_t count() const { return positions.size() / 3; }
};

}  // namespace cloam
