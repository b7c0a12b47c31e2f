// The geometry of the captures that a run was fitted to, kept in the run folder (scene.json): a method can be rebuilt
// from it without the data.
#pragma once
#include <filesystem>

#include "models/scene/scene.h"

namespace cloam {

void write_scenes(const std::filesystem::path& path, const Scenes& scenes);

/// All but the root, the warnings and the masks; at least one scene. Fault::data for a damaged file.
Scenes read_scene_file(const std::filesystem::path& path);

}  // namespace cloam
