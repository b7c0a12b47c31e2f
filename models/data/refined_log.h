// A driving log once more, with other boxes.
#pragma once
#include <filesystem>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// Writes `log`, which has PandaSet's layout, into `folder`: all files are linked or copied, and in the cuboids position
/// and yaw of every box that `actors` has (by id and step) are those given there; other rows and columns stay, but for
/// columns of a kind that we do not read (dates, categories).
/// Fault::usage for a log of another layout; Fault::write.
void write_refined_log(const std::filesystem::path& folder, const Scene& log, const std::vector<Actor>& actors);

}  // namespace cloam
