// The geometry of the captures that a run was fitted to, kept in the run folder (scene.json): a method can be rebuilt
// from it without the data.
#pragma once
#include <filesystem>

#include "models/scene/scene.h"

namespace cloam {

/// Also the file of all actors' boxes beside it (box_file.h), first: a crash leaves what was there before, or all.
/// Fault::write.
void write_scenes(const std::filesystem::path& path, const Scenes& scenes);

/// All but the root, the warnings and the masks; at least one scene. Also of files that list the boxes themselves
/// (schema 2). Fault::data for a damaged or missing file.
Scenes read_scene_file(const std::filesystem::path& path);

}  // namespace cloam
