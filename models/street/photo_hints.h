// What a log knows of its photos beside their colours: how far LiDAR saw there, where nothing is, where actors may be.
#pragma once
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

}  // namespace cloam
