// Captures described by transforms.json, in the flavours of NeRF-synthetic (transforms_train.json,
// transforms_test.json), instant-ngp and nerfstudio. docs.nerf.studio, "Data conventions"; instant-ngp,
// docs/nerf_dataset_tips.md
#pragma once
#include <filesystem>

#include "models/data/reader.h"
#include "models/io/json.h"

namespace cloam {

bool is_transforms_json(const std::filesystem::path& root);

/// Listed images that do not exist are skipped with one warning. Fault::data for anything else that is wrong (with
/// options.skip_bad, a wrong frame is dropped with a warning), and if no frame is left.
Scene read_transforms_json(const std::filesystem::path& root, const ReadOptions& options);

/// Intrinsics by these formats' keys: fl_x, fl_y or camera_angle_x, camera_angle_y, and optionally cx, cy, w, h,
/// camera_model, k1 to k4, p1, p2. The frame's own win over the file's; a size that neither has is that of the image.
Camera read_camera_json(const Json& file, const Json& frame, const std::filesystem::path& image,
                        const std::string& where);

}  // namespace cloam
