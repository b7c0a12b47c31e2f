// The geometry of the capture that a run was fitted to, kept in the run folder (scene.json): a method can be rebuilt
// from it without the data.
#pragma once
#include <filesystem>

#include "models/scene/scene.h"

namespace cloam {

void write_scene(const std::filesystem::path& path, const Scene& scene);

/// All but the root, the warnings and the masks. Fault::data for a damaged file.
Scene read_scene_file(const std::filesystem::path& path);

}  // namespace cloam
