// Depth maps beside photos: of nerfstudio's lists and of apps that scan with a phone.
#pragma once
#include <filesystem>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// A confidence below this is that of a guess: of Polycam's 0 (low), 54 (medium) and 255 (high), what it calls low.
constexpr int kLeastConfidence = 54;

/// What one in a file stands for unless the list says: whole numbers (PNG) are millimetres, others are scene units.
double usual_depth_unit(const std::filesystem::path& file);

/// The photo that depths are wanted for.
struct DepthPhoto {
  int width = 0, height = 0;  // upright, at full size
  int turn = 1;               // EXIF's orientation, by which it was turned
  int factor = 1;             // each pixel of `camera` is so many a side
  Camera camera;              // at the size wanted
};

/// [camera.height, camera.width] along the optical axis, in scene units; 0: not known (0, less or no number in the
/// file, too little confidence, or behind the camera). A map of another size gives its nearest pixel. Fault::data, with
/// the file's name, for a map that is missing, damaged, no PNG, EXR, .npy or COLMAP's .bin of one plane, or of another
/// shape than the photo.
std::vector<float> depth_of(const std::filesystem::path& root, const DepthMap& map, const DepthPhoto& photo);

}  // namespace cloam
