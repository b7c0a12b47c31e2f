// A training and its run folder: what is read and built before it begins, what the folder says of it, where it goes on.
// `cloam train` and Python's cloam.Training are made of these.
#pragma once
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "models/runs/training_sources.h"
#include "models/train/learns_from_captures.h"
#include "runtime/error.h"

namespace cloam {

/// What a training learns from, as it was read.
struct TrainingInput {
  Captures captures;  // none where it learns from a run
  std::vector<DataNow> now;
};

/// What images and sweeps may take on the host, where nobody says: half of what the host has free, but 15 % of it where
/// the device is a CPU, whose buffers lie there, too (and may take 80 %). The device must be open.
uint64_t default_host_budget();

/// Reads and checks the data, builds the job's method, and gives it the run that it learns from, networks and a prior.
/// The device must be open. Writes nothing. host_bytes: what images and sweeps may take there.
TrainingInput read_input(TrainJob& job, const TrainRequest& request, uint64_t host_bytes, const CapturesTold& told);

/// The photos that train, at the size they are used at.
PhotoSizes sizes_of(const Captures& captures);
/// What the job's training will take, also into its record.
MemoryPlan plan_memory(TrainJob& job, const PhotoSizes& photos, uint64_t host_bytes);
/// Fault::memory, naming what would fit, if the plan is over the device's budget.
void check_memory(const MemoryPlan& plan, const TrainJob& job, const Captures& captures);

/// Gives the method the captures' data; gives back their scenes.
Scenes give_data(TrainJob& job, Captures captures, const std::function<void(std::size_t done, std::size_t all)>& told);

/// The checkpoint that a resumed run goes on from; none, with a warning, if it was ended before its first.
std::optional<LoadedCheckpoint> checkpoint_to_go_on(const TrainJob& job,
                                                    const std::function<void(const std::string&)>& warn);
/// Where the checkpoint stands, into the job's record.
void take_progress(TrainJob& job, const std::optional<LoadedCheckpoint>& checkpoint, const TrainRequest& request);

/// Writes the record of a training that begins. command_line: as it was asked for. The folder is locked.
void begin_record(TrainJob& job, const std::vector<DataNow>& data, bool overwrite, const std::string& command_line);
/// Writes the settings and the scenes, if the folder has none yet.
void write_settings(const TrainJob& job, const Scenes& scenes);
/// What the job's record says of how it is to be trained.
TrainOptions options_of(const TrainJob& job, const TrainRequest& request);
/// Writes how the training ended: finished, interrupted, out of time or stopped.
void end_record(TrainJob& job, const TrainResult& result);
/// Writes that it failed.
void end_failed_record(TrainJob& job);
/// The end of the message of a fault: what the run folder holds, and how to go on. saved: the step of the last
/// checkpoint.
std::string way_on(const TrainJob& job, Fault fault, int64_t saved);

}  // namespace cloam
