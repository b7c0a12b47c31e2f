// One trainer for all methods: steps, schedule, saving, resuming, time budget, interruption. It prints nothing: what
// happens goes to a listener.
#pragma once
#include <atomic>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>

#include "models/train/method.h"
#include "models/train/ranks.h"

namespace cloam {

class Optimiser;

/// Seconds since any moment.
double steady_seconds();

struct TrainOptions {
  std::optional<int64_t> steps;               // the last step; of a training that begins also the horizon
  std::optional<double> time_budget_seconds;  // from process start to the saved checkpoint; chooses the horizon
  double seconds_before = 0;                  // already passed since process start when train() is called
  int64_t stop_after = 0;                     // stop (and save) after this step; 0: run to the last
  int64_t save_every = 0;                     // steps; 0: by save_seconds
  double save_seconds = 300;                  // between saves, or more where they would take 2 % of the time
  int64_t default_steps = 1000;
  uint64_t seed = 42;
  int64_t shares = 1;             // of each step's batch, a multiple of the ranks: their gradients are summed in order
  const Ranks* ranks = &alone();  // that train together; the first one saves
  std::function<double()> clock = steady_seconds;  // what a time budget goes by
};

struct StepReport {
  Progress progress;
  int64_t end = 0;                     // the last step; 0 while unknown
  double loss = 0, seconds = 0;        // seconds since train() was called
  double step_seconds = 0;             // of this step
  double rate = 0;                     // learning rate of the first group of parameters that is not frozen
  std::optional<double> seconds_left;  // until the checkpoint is saved; none until it can be told honestly
  std::map<std::string, double> metrics;
};

struct TrainListener {
  std::function<void(const StepReport&)> step = [](const StepReport&) {};
  std::function<void(int64_t step, const std::filesystem::path&)> checkpoint = [](int64_t,
                                                                                  const std::filesystem::path&) {};
  std::function<void(const std::string&)> warning = [](const std::string&) {};
};

struct TrainResult {
  int64_t step = 0, horizon = 0;
  int64_t end = 0;  // the last step of this training; 0 while unknown
  double seconds = 0, loss = 0;
  bool interrupted = false, out_of_time = false;
  std::filesystem::path checkpoint;
};

/// Trains `method` (built, with data). Saves to `checkpoints` (run/ckpt). `metadata` goes into every checkpoint as it
/// is. Goes on from `resume` when given: parameters, optimiser, horizon and step are taken from it, the result is the
/// same bytes as an uninterrupted run. `stop` is set by signal handlers: the step is finished, a checkpoint saved.
/// When the loss or a parameter is not finite, it goes back to the last checkpoint, once, and takes the same steps
/// again, the last of them op by op. Where they are finite then, it goes on with a warning: the device erred.
/// Otherwise, and where there is no checkpoint: Fault::diverged, which names the op (nothing is saved over the last
/// good checkpoint). Fault::data where what a step reads is damaged; the step before it is saved.
struct TrainRun {
  Method& method;
  std::filesystem::path checkpoints;
  std::map<std::string, std::string> metadata;
  const SafetensorsFile* resume = nullptr;
  const std::atomic<int>* stop = nullptr;
};
TrainResult train(const TrainRun& run, const TrainOptions& options, const TrainListener& listener);

/// The same step by step, for who does something between them. One thread at a time.
class Training {
 public:
  /// What `run` names must live as long as this.
  Training(const TrainRun& run, const TrainOptions& options, const TrainListener& listener);
  ~Training();
  Training(const Training&) = delete;
  Training& operator=(const Training&) = delete;
  /// Makes the next step, and saves it where that is due. False, and no step, where the training is at its end, was
  /// asked to stop or has no time left.
  bool step();
  /// Saves now, unless the last step is saved.
  void save();
  /// As far as it is.
  TrainResult result() const;

 private:
  class Loop;
  std::unique_ptr<Loop> loop_;
};

/// The parameters that a checkpoint holds, under their names in the model.
TensorMap parameters_in(const SafetensorsFile& checkpoint);
/// Of sparse parameters, under the same names: the steps that trained each row.
TensorMap row_steps_in(const SafetensorsFile& checkpoint);
/// The tensor of a checkpoint that holds them.
std::string row_steps_name(const std::string& parameter);
/// Parameters, state and progress as a checkpoint holds them; of the optimiser nothing.
SafetensorsFile checkpoint_of(Method& method, const Progress& progress, std::map<std::string, std::string> metadata);

/// Parameters, state and progress of a checkpoint into a built method. Fault::data listing missing, extra and misshapen
/// names in one message.
Progress restore_method(Method& method, const SafetensorsFile& checkpoint);
/// Of an optimiser of the method's parameters, once those are restored.
void restore_optimiser(Optimiser& optimiser, const SafetensorsFile& checkpoint);

}  // namespace cloam
