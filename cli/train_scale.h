// What a training would take on more devices than there are: `cloam train --dry-run --ranks N --link SPEED`.
#pragma once
#include "cli/progress.h"
#include "models/runs/training_job.h"

namespace cloam {

/// "100Gb" -> bytes a second (bits, as links are sold; "12GB" for bytes). Fault::usage.
double parse_link(const std::string& words);

struct ScaleQuestion {
  int64_t ranks = 1;
  std::string link = {};                    // as parse_link reads it
  const SafetensorsFile* resume = nullptr;  // a checkpoint from which the training goes on
};

/// Takes a few steps with the job's method, which has its data, as one device would and as one of
/// several that are all like it, and tells both. The method has learned a little afterwards. Fault::usage.
void tell_scale(TrainJob& job, const ScaleQuestion& question, const Common& common, EventLog& log);

}  // namespace cloam
