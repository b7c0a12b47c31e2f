// Evaluations and distances: for the command line, and for commands that need their figures.
#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "cli/common.h"
#include "models/eval/photos.h"
#include "models/eval/report.h"

namespace cloam {

/// Measures a run and writes RUN/eval; returns what `eval --json` prints, and prints nothing on stdout.
nlohmann::ordered_json measure_run(const EvalRequest& request, const Common& common);

/// What an evaluation found, for people: of photos, and of a run of diffusion.
std::string table(const EvalResult& result);
std::string prior_table(const nlohmann::ordered_json& figures);

struct DistanceRequest {
  std::vector<std::string> folders;  // two
  std::string features;              // weights of a feature network, or "random"
};

/// What `distance --json` prints; prints nothing on stdout. Fault::data for folders of less than two images.
nlohmann::ordered_json measure_distance(const DistanceRequest& request, const Common& common);

}  // namespace cloam
