// Gaussians of a run as a file of splats.
#pragma once
#include <string>

#include "cli/common.h"
#include "models/gaussians/gaussians.h"
#include "models/runs/restore_run.h"

namespace cloam {

struct SplatExport {
  std::string format;  // "ply"; empty: the file's extension
  std::string out;
};

/// Writes the file, reads it again, and prints how like the model's the pictures of what was read are. The exit code.
int export_splats(const RestoredRun& run, const Gaussians& gaussians, const SplatExport& request, const Common& common);

}  // namespace cloam
