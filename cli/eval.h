// An evaluation as a request: for the command line, and for commands that need its figures.
#pragma once
#include <nlohmann/json_fwd.hpp>

#include "cli/common.h"
#include "models/eval/photos.h"

namespace cloam {

/// Measures a run and writes RUN/eval; returns what `eval --json` prints, and prints nothing on stdout.
nlohmann::ordered_json measure_run(const EvalRequest& request, const Common& common);

}  // namespace cloam
