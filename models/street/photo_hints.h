// What a log knows of its photos beside their colours: how far LiDAR saw there, where nothing is, where actors may be.
#pragma once
#include <optional>

#include "models/batches/log_source.h"
#include "models/street/street_space.h"

namespace cloam {

/// LiDAR's returns as a photo's camera sees them.
struct PixelDepths {
  std::vector<int32_t> pixels;  // [N]: row * width + column
  std::vector<float> depths;    // [N]: along the camera's axis, metres
};

/// Of the sweep of the frame's step. Returns within boxes of actors go with them to the photo's time. A LiDAR stands
/// higher than cameras and sees over things: returns that are a tenth further away than one beside them are left out.
/// camera: the pinhole of the photo.
PixelDepths pixel_depths(const Scene& scene, const Frame& frame, const Camera& camera, const Sweep& sweep,
                         const LidarPoints& points);

/// What is at a pixel; none of them: nobody knows.
enum PixelKind : uint8_t {
  kSkyPixel = 1,     // its ray meets no voxel in which anything was seen, nor a box
  kMatterPixel = 2,  // LiDAR has a return beside it
  kActorPixel = 4    // a box is there
};

/// [H,W] of PixelKind. `space` has looked at the log; without sweeps no pixel is of the sky.
std::vector<uint8_t> pixel_kinds(const Scene& scene, const Frame& frame, const Camera& camera, const StreetSpace& space,
                                 const PixelDepths& depths);

/// The boxes of a photo, coarsely.
class BoxesInPhoto {
 public:
  /// kinds: of pixel_kinds.
  BoxesInPhoto(const Camera& camera, const Eigen::Matrix4d& world_from_camera, const std::vector<uint8_t>& kinds);
  /// Whether a box is where the photo shows a point of the world; none: the photo does not show its place.
  std::optional<bool> covers(const Eigen::Vector3d& point) const;

 private:
  Camera camera_;
  Eigen::Matrix4d camera_from_world_;
  int cell_, columns_;
  std::vector<bool> there_;  // of cells, row by row
};

/// Of points [N,3] in the world: whether photos show its place, each of them where a box is.
std::vector<bool> only_in_boxes(const std::vector<float>& points, const std::vector<BoxesInPhoto>& photos);

}  // namespace cloam
