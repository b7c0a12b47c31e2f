// A training as a request: what the command line, a resumed run and the demo fill in.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "cli/common.h"
#include "models/runs/captures.h"
#include "models/train/method.h"

namespace cloam {

struct TrainRequest {
  std::string method;
  std::vector<std::string> data;
  std::vector<std::string> new_data;  // --data: where a resumed run finds its data now
  std::string networks;               // --networks: the run whose networks are taken
  std::string prior;                  // --prior: the run of diffusion whose knowledge of codes is used
  std::string out, preset, config_file;
  std::optional<int64_t> steps;
  std::string time_budget;  // as typed
  std::optional<int64_t> seed, save_every;
  std::optional<int> downscale, holdout, sparse_every;
  std::string protocol, image, masks;
  int64_t stop_after = 0;
  bool skip_bad = false, allow_outside = false, resume = false, overwrite = false, dry_run = false;
  std::vector<std::string> settings;  // key=value
  std::string progress = "auto";
};

/// Returns the exit code: 0, or 130 and 143 after a signal with everything saved. Errors as the program's faults.
int run_train(TrainRequest request, const Common& common);

}  // namespace cloam
