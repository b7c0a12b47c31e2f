// Captures described by transforms.json, in the flavours of NeRF-synthetic (transforms_train.json,
// transforms_test.json), instant-ngp and nerfstudio. docs.nerf.studio, "Data conventions"; instant-ngp,
// docs/nerf_dataset_tips.md
#pragma once
#include <filesystem>

#include "models/data/reader.h"

namespace cloam {

bool is_transforms_json(const std::filesystem::path& root);

/// Listed images that do not exist are skipped with one warning. Fault::data for anything else that is wrong (with
/// options.skip_bad, a wrong frame is dropped with a warning), and if no frame is left.
Scene read_transforms_json(const std::filesystem::path& root, const ReadOptions& options);

}  // namespace cloam
