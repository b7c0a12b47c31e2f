// Evaluation of runs that learned from the assets of another run: how well noise is told from assets held out.
#pragma once
#include "cli/eval.h"

namespace cloam {

/// Measures and writes RUN/eval/eval.json; returns what `eval --json` prints. Fault::usage for options that go with
/// photos.
nlohmann::ordered_json measure_prior(const EvalRequest& request, const Common& common);

/// What `eval` prints for people.
std::string prior_table(const nlohmann::ordered_json& figures);

}  // namespace cloam
