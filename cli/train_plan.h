// The plan of a training, told before anything is written.
#pragma once
#include "cli/progress.h"
#include "models/runs/captures.h"
#include "models/runs/training_job.h"

namespace cloam {

/// What images and sweeps may take on the host. typed: --host-memory; empty: half of what the host has free, but 15 %
/// of it where the device is a CPU, whose buffers lie there, too (and may take 80 %). The device must be open.
uint64_t host_budget(const std::string& typed);

/// Tells images, memory, device and warnings; the memory goes into the job's record. host_budget: bytes. Fault::memory,
/// naming what would fit, if the plan is over the device's budget.
void tell_plan(TrainJob& job, const Captures& captures, uint64_t host_budget, const Common& common, EventLog& log);

}  // namespace cloam
