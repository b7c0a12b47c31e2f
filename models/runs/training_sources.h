// What a training learns from: data as its record names them, the run whose networks it takes, the run of diffusion
// that is its prior.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "models/runs/captures.h"
#include "models/runs/training_job.h"

namespace cloam {

/// What a run learns from, as it lies there now.
struct DataNow {
  std::filesystem::path root;
  std::string fingerprint;
};

std::vector<DataNow> data_now(const TrainJob& job, const Captures& captures);
/// Fault::data where it is not what the run was trained on.
void check_data_unchanged(const TrainJob& job, const std::vector<DataNow>& data);
/// Into the job's record.
void note_places(TrainJob& job, const std::vector<DataNow>& data);
/// What is known of the clocks of logs, into the job's record.
void note_recordings(TrainJob& job, const Captures& captures);

/// The networks of the run named by --networks; a run that goes on has them in its own checkpoints and needs no other.
/// Fault::usage for a method that shares none.
void adopt_networks(TrainJob& job, const TrainRequest& request);

/// Gives the method what the prior knows, after adopt_networks. Fault::usage for a run that is no prior or learned from
/// other networks than the training uses, Fault::data for one that is gone or was changed since the training began.
void adopt_prior(TrainJob& job, const TrainRequest& request);

}  // namespace cloam
