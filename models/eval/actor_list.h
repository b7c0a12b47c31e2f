// The actors of a street, listed and drawn.
#pragma once
#include <filesystem>
#include <nlohmann/json.hpp>

#include "models/runs/restore_run.h"

namespace cloam {

/// What `edit --list --json` prints, but for the thumbnails: logs with their times, actors with their boxes and the
/// places of their thumbnails.
nlohmann::ordered_json list_of_actors(const RestoredRun& run);

/// Draws a sheet of all actors into the folder, below each its number, the beginning of its id and its label. The file.
std::filesystem::path write_thumbnails(const RestoredRun& run, const nlohmann::ordered_json& list,
                                       const std::filesystem::path& folder);

}  // namespace cloam
