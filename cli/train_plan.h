// The plan of a training, told before anything is written.
#pragma once
#include "cli/progress.h"
#include "models/runs/captures.h"
#include "models/runs/training_job.h"

namespace cloam {

/// Tells images, memory, device and warnings; the memory goes into the job's record. host_budget: bytes. Fault::memory,
/// naming what would fit, if the plan is over the device's budget.
void tell_plan(TrainJob& job, const Captures& captures, uint64_t host_budget, const Common& common, EventLog& log);

}  // namespace cloam
