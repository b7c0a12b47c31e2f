// The boxes of all actors of a run as arrays, in a file beside its scene.json: a million of them are 112 MB; as JSON
// they would be more than its reader takes.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

constexpr int kMaxSteps = 1 << 24;  // of a log in a run folder

/// Writes the boxes of all actors, scene by scene and actor by actor, to a file in `folder`, and gives its name; "" and
/// no file where there are none. The name holds a digest of the content, so that a scene.json which names the file
/// never stands beside the boxes of another writing. Fault::write.
std::string write_boxes(const std::filesystem::path& folder, const Scenes& scenes);

/// All boxes in the order in which they were written. Fault::data for a file that is missing or damaged.
std::vector<ActorBox> read_boxes(const std::filesystem::path& folder, const std::string& name);

/// The files in `folder` that write_boxes wrote.
std::vector<std::filesystem::path> box_files(const std::filesystem::path& folder);

}  // namespace cloam
