// The run of diffusion that a training names as its prior (--prior).
#pragma once
#include "cli/train_job.h"

namespace cloam {

/// Gives the method what the prior knows, after adopt_networks. Fault::usage for a run that is no prior or learned from
/// other networks than the training uses, Fault::data for one that is gone or was changed since the training began.
void adopt_prior(TrainJob& job, const TrainRequest& request);

}  // namespace cloam
