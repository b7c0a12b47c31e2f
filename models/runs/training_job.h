// A training before it starts: request and run folder become a job.
#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "models/runs/listener.h"
#include "models/runs/restore_run.h"

namespace cloam {

/// A training as the command line and resumed runs ask for it.
struct TrainRequest {
  std::string method;
  std::vector<std::string> data;
  std::vector<std::string> new_data;  // --data: where a resumed run finds its data now
  std::string networks;               // --networks: the run whose networks are taken
  std::string prior;                  // --prior: the run of diffusion whose knowledge of codes is used
  std::string out, preset, config_file;
  std::string precision;  // full or mixed; empty: full, of a resumed run as it began
  std::optional<int64_t> steps;
  std::optional<double> time_budget;  // seconds
  std::optional<int64_t> seed, save_every;
  std::optional<int64_t> accumulation;  // shares of a batch that each rank takes, one after the other
  int64_t ranks = 1;                    // that train together
  std::optional<int> downscale, holdout, sparse_every;
  std::string protocol, image, masks, actors;
  int64_t stop_after = 0;
  bool skip_bad = false, allow_outside = false, resume = false, overwrite = false, dry_run = false;
  std::vector<std::string> settings;  // key=value
  std::string host_memory;            // --host-memory, as typed; empty: a share of what is free
  std::string progress = "auto";
  std::string devices;                                  // --devices: of the ranks of a host, between commas
  int64_t planned_ranks = 0;                            // --dry-run --ranks: devices to plan for; 0: none
  std::string link = "100Gb";                           // --link, as typed: what each of them is linked with
  std::optional<int> view;                              // --view: the port; 0: any
  std::string preview_every = "auto", pictures = "on";  // as typed
  bool tensorboard = false;                             // event files, too
};

struct TrainJob {
  std::filesystem::path folder;
  std::vector<std::filesystem::path> data;
  RunRecord record;
  Config config;
  std::unique_ptr<Method> prior;  // of --prior: what `method` calls
  std::unique_ptr<Method> method;
  std::optional<StoredRun> source;        // of methods that learn from a run: that run, until it is loaded
  int64_t default_steps = 0, epochs = 0;  // of the preset
  int64_t shares_before = 1;              // of a resumed run: that its batches were split into
  bool finished = false;                  // a resumed run that has nothing left to do
};

/// A new run. Reads no data but a run to learn from. Fault::usage for unknown names, settings that are wrong, and for a
/// folder that exists (unless --overwrite is given and it is a run).
TrainJob new_job(const TrainRequest& request, const Listener& listener);

/// Fault::usage for a folder that holds anything, unless it is a run that may be overwritten.
void check_folder(const std::filesystem::path& folder, bool overwrite);

/// A run that goes on: all from its record. Fault::usage for options that contradict it.
TrainJob resumed_job(const TrainRequest& request);

/// Where the training is to end, once its horizon is known.
int64_t last_step(const RunRecord& record);

/// The folder's name, for people and for names of runs.
std::string name_of_data(const std::filesystem::path& data);

}  // namespace cloam
