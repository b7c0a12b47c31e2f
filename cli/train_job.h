// A training before it starts: request and run folder become a job; the plan is told before anything is written.
#pragma once
#include <filesystem>
#include <memory>
#include <optional>

#include "cli/progress.h"
#include "cli/train.h"
#include "models/runs/restore_run.h"

namespace cloam {

struct TrainJob {
  std::filesystem::path folder;
  std::vector<std::filesystem::path> data;
  RunRecord record;
  Config config;
  std::unique_ptr<Method> prior;  // of --prior: what `method` calls
  std::unique_ptr<Method> method;
  std::optional<StoredRun> source;  // of methods that learn from a run: that run, until it is loaded
  int64_t default_steps = 0;
  bool finished = false;  // a resumed run that has nothing left to do
};

/// A new run. Reads no data but a run to learn from. Fault::usage for unknown names, settings that are wrong, and for a
/// folder that exists (unless --overwrite is given and it is a run).
TrainJob new_job(const TrainRequest& request);

/// Fault::usage for a folder that holds anything, unless it is a run that may be overwritten.
void check_folder(const std::filesystem::path& folder, bool overwrite);

/// A run that goes on: all from its record. Fault::usage for options that contradict it.
TrainJob resumed_job(const TrainRequest& request);

/// Tells images, memory, device and warnings. Fault::memory, naming what would fit, if the plan is over the budget.
void tell_plan(const TrainJob& job, const Captures& captures, const Common& common, EventLog& log);

}  // namespace cloam
