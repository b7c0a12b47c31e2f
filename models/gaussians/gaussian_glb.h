// GLB with KHR_gaussian_splatting (ratified by the Khronos Group in 2026; the ellipse kernel): a primitive of points
// with POSITION and, each after "KHR_gaussian_splatting:", ROTATION (x y z w), SCALE (deviations), OPACITY (0 to 1) and
// SH_DEGREE_l_COEF_n (n from m = -l to l, red green blue, 3DGS's signs). glTF's axes: y is up.
#pragma once
#include <filesystem>

#include "models/gaussians/formats.h"

namespace cloam {

/// All such primitives of the scene together, moved as their nodes say. Fault::data for a GLB without one, for nodes
/// that shear or stretch them unevenly, and for extensions that compress them.
SplatFile read_gaussian_glb(const std::filesystem::path& path);

/// One node; COLOR_0 besides, for viewers that show points. Whether a unit is a metre stands in asset.extras.
void write_gaussian_glb(const std::filesystem::path& path, const Gaussians& gaussians);

}  // namespace cloam
