// The distance of two sets of pictures as a request: what the command line and the demo fill in.
#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "cli/common.h"

namespace cloam {

struct DistanceRequest {
  std::vector<std::string> folders;  // two
  std::string features;              // weights of a feature network, or "random"
};

/// What `distance --json` prints; prints nothing on stdout. Fault::data for folders of less than two images.
nlohmann::ordered_json measure_distance(const DistanceRequest& request, const Common& common);

}  // namespace cloam
