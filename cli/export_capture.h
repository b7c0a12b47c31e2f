// `export --format capture`: the data of a run once more, with the poses or the boxes that the run learned.
#pragma once
#include <string>

#include "cli/options.h"
#include "models/runs/restore_run.h"

namespace cloam {

struct CaptureExport {
  std::string run, out;  // folders
};

/// Returns the command's exit code. Fault::usage for a run that learned neither.
int export_capture(const RestoredRun& run, const CaptureExport& request, const Common& common);

}  // namespace cloam
