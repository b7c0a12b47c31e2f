// The folder of checkpoints of a run: NNNNNN.safetensors by step, latest.txt with the name of the newest, the last 3
// kept.
#pragma once
#include <cstdint>
#include <filesystem>
#include <string>

#include "models/io/safetensors.h"

namespace cloam {

/// Saves `file` as the checkpoint of `step`, reads it back, names it in latest.txt and only then removes the older
/// ones. Checkpoints of later steps are removed too: they belong to a run that was resumed from before them. Errors: as
/// write_safetensors; Fault::write when what is read back differs (the checkpoints before stay).
std::filesystem::path save_checkpoint(const std::filesystem::path& folder, int64_t step, const SafetensorsFile& file);

/// warning: empty, or which newer checkpoints were damaged and passed over.
struct LoadedCheckpoint {
  int64_t step = 0;
  std::filesystem::path path;
  SafetensorsFile file;
  std::string warning;
};

/// Whether the folder holds any checkpoint, sound or not.
bool has_checkpoints(const std::filesystem::path& folder);

/// Loads the checkpoint that latest.txt names, or the newest whole one. Fault::data when there is none.
LoadedCheckpoint load_latest_checkpoint(const std::filesystem::path& folder);

}  // namespace cloam
