// What a picture knows besides its colours, for people to look at.
#pragma once
#include "models/io/image.h"
#include "models/scene/view.h"

namespace cloam {

/// By the logarithm of the depth, from red for what is near to blue for what is far: the ends are the depths that 2 %
/// of the picture's pixels are nearer and farther than. Black where more than half of the light passes through.
Image depth_picture(const Picture& picture);

/// Normals [H,W,3] of the surface that the depths make, towards the camera and in its axes (x right, y down, z
/// forward), of length 1; zeros where more than half of the light passes through, and at edges.
std::vector<float> surface_normals(const Picture& picture, const Camera& camera);

/// Those normals: red is how much it looks to the right, green up,
/// blue towards the camera, from -1 (0) to 1 (255). Black where there is no surface, or an edge of one.
Image normal_picture(const Picture& picture, const Camera& camera);

/// White where nothing lies behind what is seen.
Image opacity_picture(const Picture& picture);

}  // namespace cloam
