// A run folder with the same model and edited scenes.
#pragma once
#include <filesystem>

#include "models/train/run_folder.h"

namespace cloam {

/// Writes the run `to` from the run `from`: its newest whole checkpoint (linked where the disk can, for checkpoints are
/// never changed), its settings, the edited scenes, and a record that names `from`. It stands alone: `from` may be
/// removed afterwards. Fault::usage if `to` holds anything; Fault::data for a damaged run; Fault::write.
void write_edited_run(const std::filesystem::path& from, const std::filesystem::path& to, const Scenes& scenes,
                      const std::string& command_line);

}  // namespace cloam
