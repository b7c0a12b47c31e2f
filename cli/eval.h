// An evaluation as a request: what the command line and the demo fill in.
#pragma once
#include <string>

#include "cli/common.h"

namespace cloam {

struct EvalRequest {
  std::string run, other, images;  // images: folder for the pictures (default RUN/eval/images)
  std::string protocol;            // empty: the run's own
  std::string features;            // weights of a feature network, or "random"; empty: no feature distances
};

/// Measures a run, writes RUN/eval, prints a table or one JSON object. Errors as the program's faults.
int run_eval(const EvalRequest& request, const Common& common);

}  // namespace cloam
