// An evaluation as a request: what the command line and the demo fill in.
#pragma once
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

#include "cli/common.h"
#include "models/nn/feature_network.h"

namespace cloam {

struct EvalRequest {
  std::string run, other, images;         // images: folder for the pictures (default RUN/eval/images)
  std::string protocol;                   // empty: the run's own
  std::string features;                   // weights of a feature network, or "random"; empty: no feature distances
  std::optional<std::size_t> scene = {};  // of the run: that one alone
  bool allow_outside = false;             // as Reading has it, over what the run says
};

/// The network that --features names. Fault::data for a file that holds none.
FeatureNetwork features_named(const std::string& features);

/// Measures a run and writes RUN/eval; returns what `eval --json` prints, and prints nothing on stdout.
nlohmann::ordered_json measure_run(const EvalRequest& request, const Common& common);

/// measure_run, and a table or one JSON object on stdout. Errors as the program's faults.
int run_eval(const EvalRequest& request, const Common& common);

}  // namespace cloam
