// Any capture that we know, whatever its format: the folder's content decides.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "models/data/reader.h"

namespace cloam {

/// Fault::data if `path` is no folder or no known capture; the error says what was looked for, what was found and
/// what to do. `path` may be a link; Scene::root is the real folder. ROOT/scene-0061 is a scene of a nuScenes folder
/// ROOT.
Scene read_scene(const std::filesystem::path& path, const ReadOptions& options = {});

/// A folder, or a scene of a nuScenes folder. Never throws.
bool is_place_of_data(const std::filesystem::path& path);

/// What looks odd but may be meant, one line each: names or poses that occur twice, cameras all in one place, far from
/// the origin or at scales that train badly.
std::vector<std::string> check_scene(const Scene& scene);

}  // namespace cloam
