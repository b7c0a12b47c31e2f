// A capture of photos as others read it, in nerfstudio's transforms.json.
#pragma once
#include <filesystem>

#include "models/scene/scene.h"

namespace cloam {

/// Writes transforms.json and links or copies the images, masks and depth maps beside it, so that the folder stands by
/// itself; of NeRF-synthetic transforms_train.json and transforms_test.json, which say where the object is. Poses,
/// cameras and points (points.ply) are those of `scene`; its images lie under its root. Fault::usage for a lens that
/// the format has no words for; Fault::write.
void write_transforms(const std::filesystem::path& folder, const Scene& scene);

}  // namespace cloam
