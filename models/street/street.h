// Methods that know actors and LiDAR.
#pragma once
#include <vector>

#include "models/scene/view.h"

namespace cloam {

/// Rays in the world frame of a scene; directions of length 1.
struct WorldRays {
  int scene = 0;
  double time = 0;
  std::vector<float> origins, directions;  // [R,3]
  std::vector<double> times = {};          // [R] seconds; empty: all are of `time`
};

/// What a LiDAR would measure along rays, [R] each.
struct LidarReturns {
  std::vector<float> depths;  // metres; 0: nothing is hit
  std::vector<int> actors;    // as Picture::actors
  // Of methods that know them, else empty: 0 to 1, and how likely it is that nothing comes back.
  std::vector<float> intensities = {}, drops = {};
};

class Street {
 public:
  virtual ~Street() = default;
  virtual LidarReturns measure(const WorldRays& rays) = 0;
  /// The asset alone, on white. box_from_camera: the view in the axes of the actor's box (metres, origin its centre).
  virtual Picture render_asset(const AssetName& asset, const Camera& camera,
                               const Eigen::Matrix4d& box_from_camera) = 0;
};

}  // namespace cloam
