// The plan of a training, told before anything is written.
#pragma once
#include "cli/progress.h"
#include "models/runs/captures.h"
#include "models/runs/training_job.h"

namespace cloam {

/// Tells images, memory, device and warnings. Fault::memory, naming what would fit, if the plan is over the budget.
void tell_plan(const TrainJob& job, const Captures& captures, const Common& common, EventLog& log);

}  // namespace cloam
