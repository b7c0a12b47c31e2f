// A run folder with the same model and edited scenes.
#pragma once
#include <filesystem>

#include "models/runs/restore_run.h"

namespace cloam {

/// Writes the run `to` from the run that `edited` was read from: its newest whole checkpoint (linked where the disk
/// can, for checkpoints are never changed), its settings, the edited scenes and generated assets, and a record that
/// names its folder. It stands alone: that folder may be removed afterwards. Fault::usage if `to` holds anything;
/// Fault::write, and nothing of it is left.
void write_edited_run(const StoredRun& edited, const std::filesystem::path& to, const std::string& command_line);

}  // namespace cloam
