// The sky of a photo: what LiDAR says, followed to the edges that the photo shows.
#pragma once
#include <cstdint>
#include <vector>

#include "models/scene/pixels.h"

namespace cloam {

/// Changes kinds [H,W] of PixelKind. LiDAR's sky ends a voxel or more beside things, and lies over things that are too
/// far for returns. Pixels that may be sky are split where neighbours differ; an area without an edge is of the sky,
/// all of it, if LiDAR says so of most of it and it looks like the largest such area; of others nobody knows. A photo
/// with hardly any sky stays as it is.
void follow_sky(std::vector<std::uint8_t>& kinds, const FramePixels& photo);

}  // namespace cloam
