// The training loop.
#include "models/train/trainer.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iterator>

#include "models/io/checkpoint.h"
#include "models/io/tensors.h"
#include "models/train/capability.h"
#include "models/train/grows.h"
#include "models/train/old_names.h"
#include "models/train/optimiser.h"
#include "models/train/shared_step.h"
#include "models/train/step_pace.h"
#include "runtime/debug.h"
#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/op.h"
#include "runtime/profile.h"

namespace cloam {
namespace {

constexpr char kParameter[] = "param.", kOptimiser[] = "adam.", kState[] = "state.";
constexpr double kTimingShare =
    0.25;                           // of a budget passes before its horizon is chosen (schedules hold still till then)
constexpr double kCaution = 0.9;    // of what is left then: a little early is better than a decay cut short
constexpr int64_t kMinPlanned = 8;  // steps between one choice and the next
constexpr int64_t kFirstSteps = 3;  // compile kernels: they tell nothing of the others
constexpr int64_t kFiniteEvery = 10;   // steps between looks at the parameters: a loss can hide that they are NaN
constexpr double kSavingShare = 0.02;  // of the time, at most
constexpr double kMostUnsaved = 3600;  // seconds of training that may be lost, where kLargestShare allows it
constexpr double kLargestShare = 0.1;  // of the time, where saves take minutes

void add_prefixed(TensorMap& to, const TensorMap& from, const std::string& prefix) {
  for (const auto& [name, tensor] : from) to[prefix + name] = tensor;
}

/// When to save, and what it takes.
class Saving {
 public:
  Saving(const Method& method, const TrainOptions& options) : method_(method), options_(options) {}
  bool is_due(int64_t step, double now) const {
    if (options_.save_every > 0) return step % options_.save_every == 0;
    const double rarely = std::min(cost() / kSavingShare, std::max(kMostUnsaved, cost() / kLargestShare));
    return now - saved_at_ >= std::max(options_.save_seconds, rarely);
  }
  /// To be on the safe side.
  double seconds() const { return cost_ > 0 ? 1.5 * cost_ : cost(); }
  /// What the longest save took; 0 before the first.
  double measured() const { return cost_; }
  void saved(double begun, double now) {
    saved_at_ = now;
    cost_ = std::max(cost_, now - begun);
  }

 private:
  /// Reading back, checksums and fsync go at some 100 MB/s; measured once a save has been made.
  double cost() const { return cost_ > 0 ? cost_ : 0.5 + 3e-8 * static_cast<double>(method_.memory({}).parameters); }

  const Method& method_;
  const TrainOptions& options_;
  double cost_ = 0, saved_at_ = 0;
};

/// How the time of a training is spent: what the steps that are left take, and the horizon that follows from a budget.
class TimePlan {
 public:
  TimePlan(const TrainOptions& options, const Grows* grows) : options_(options), grows_(grows) {}
  double seconds() const { return options_.clock() - start_; }
  void add_step(double seconds) { pace_.add(seconds); }
  bool by_budget() const { return options_.time_budget_seconds && !options_.steps; }
  double budget_left() const { return *options_.time_budget_seconds - since_process_start(); }
  bool is_up(double last_seconds) const {
    return options_.time_budget_seconds && since_process_start() + last_seconds >= *options_.time_budget_seconds;
  }
  /// From here to a step of a training that stands like this.
  std::optional<double> seconds_to(int64_t step, const Progress& progress) const {
    return pace_.seconds_for(step - progress.step, (grows_ ? grows_->grows_until(progress) : 0) - progress.step);
  }
  void choose_horizon(Progress& progress, double saving_seconds);

 private:
  double since_process_start() const { return options_.seconds_before + seconds(); }

  const TrainOptions& options_;
  const Grows* grows_;
  double start_ = options_.clock();
  int64_t next_plan_ = 0;  // step
  StepPace pace_;          // saving and telling included
};

/// The largest whose steps are made in time. Steps get faster as scenes become solid: each time that half of what was
/// planned is made, it is chosen again.
void TimePlan::choose_horizon(Progress& progress, double saving_seconds) {
  if (progress.step < next_plan_) return;
  const double budget = *options_.time_budget_seconds, now = since_process_start();
  if (now < budget * kTimingShare) return;
  const double left = kCaution * (budget - now) - saving_seconds;
  const auto fits = [&](int64_t steps) {
    Progress then = progress;
    then.horizon = progress.step + steps;
    return seconds_to(then.horizon, then).value_or(left + 1) <= left;
  };
  if (!seconds_to(progress.step + 1, progress)) return;
  int64_t few = 1, many = 2;
  while (fits(many)) few = many, many *= 2;
  while (many - few > 1) (fits((few + many) / 2) ? few : many) = (few + many) / 2;
  progress.horizon = progress.step + few;
  next_plan_ = progress.step + std::max(few / 2, kMinPlanned);
}

/// What the loop itself found: the loss or a parameter.
struct NotFinite final : Error {
  explicit NotFinite(const std::string& message) : Error(Fault::diverged, message) {}
};

/// While it lives, this thread's evaluations stop at the first op with a NaN, if that is wanted.
class NanSearch {
 public:
  explicit NanSearch(bool wanted) { look_for_nan(wanted); }
  ~NanSearch() { look_for_nan(false); }
  NanSearch(const NanSearch&) = delete;
  NanSearch& operator=(const NanSearch&) = delete;
};

}  // namespace

class Training::Loop {
 public:
  Loop(const TrainRun& run, const TrainOptions& options, const TrainListener& listener)
      : run_(run),
        options_(options),
        listener_(listener),
        grows_(as<Grows>(run.method)),
        optimiser_(run.method.parameters(), run.method.groups(), *options.ranks),
        steps_({*options.ranks, options.shares}),
        time_(options_, grows_),
        saving_(run.method, options_) {
    begin();
  }
  bool step();
  void save_if_not();
  TrainResult result() const;

 private:
  void begin();
  void one_step();
  TakenStep take_next_step();
  bool finished();
  int64_t end() const;
  void require_finite();
  [[noreturn]] void diverged(const std::string& what) const;
  void step_or_go_back();
  void go_back(const NotFinite& why);
  void save();
  std::vector<int64_t> agreed(std::vector<int64_t> mine) const;
  double learning_rate() const;
  std::optional<double> seconds_left() const;

  const TrainRun run_;
  const TrainOptions options_;
  const TrainListener listener_;
  Grows* grows_;  // null: parameters keep their rows
  Optimiser optimiser_;
  SharedSteps steps_;
  TimePlan time_;
  Saving saving_;
  std::map<std::string, double> figures_;  // of the last step
  Progress progress_;
  TrainResult result_;
  bool save_is_due_ = false;
  bool planning_ = false;  // the horizon follows from a time budget
  int64_t next_look_ = 0;  // step that looks at the parameters; the first compiles what that takes
  double step_seconds_ = 0;
  double told_at_ = 0;      // when the last step was done
  int64_t warm_after_ = 0;  // the step from which on their times count
  int64_t saved_step_ = -1;
  int64_t searched_ = 0;  // the step that was not finite, while the steps before it are taken again
  bool went_back_ = false;
};

void Training::Loop::begin() {
  progress_.seed = options_.seed;
  if (run_.resume) {
    progress_ = restore_method(run_.method, *run_.resume);
    optimiser_ = Optimiser(run_.method.parameters(), run_.method.groups(), *options_.ranks);
    restore_optimiser(optimiser_, *run_.resume);
    saved_step_ = progress_.step;
  }
  planning_ = progress_.horizon == 0 && time_.by_budget();
  if (progress_.horizon == 0 && !planning_) progress_.horizon = options_.steps.value_or(options_.default_steps);
  warm_after_ = progress_.step + kFirstSteps;
  told_at_ = time_.seconds();
}

/// Data that are read while the training goes on may turn out to be damaged: what was learned until then is saved.
TakenStep Training::Loop::take_next_step() {
  progress_.step++;
  try {
    return steps_.take(run_.method, optimiser_, progress_);
  } catch (const Error& error) {
    if (error.fault() != Fault::data) throw;
    progress_.step--;
    if (progress_.step > 0 && saved_step_ != progress_.step) save();
    meet(*options_.ranks);  // who goes first ends all
    throw;
  }
}

void Training::Loop::one_step() {
  const double before = time_.seconds();
  const TakenStep taken = take_next_step();
  figures_ = taken.figures;
  result_.loss = taken.loss;
  if (!std::isfinite(result_.loss)) diverged(text("the loss became ", result_.loss));
  save_is_due_ = agreed({saving_.is_due(progress_.step, time_.seconds())}).front();
  if (progress_.step >= next_look_ || save_is_due_ || progress_.step == end()) {
    next_look_ = progress_.step + kFiniteEvery;
    require_finite();
  }
  run_.method.after_step(progress_);
  const RowMoves moves = grows_ ? grows_->grow(progress_) : RowMoves{};
  if (!moves.empty()) {
    steps_.gather_moments(optimiser_);
    optimiser_.move_rows(run_.method.parameters(), moves, run_.method.groups());
  }
  profile_step();
  step_seconds_ = time_.seconds() - before;
}

/// The last step; 0 while unknown. A training that was finished may have been given more than its horizon.
int64_t Training::Loop::end() const {
  return progress_.horizon == 0 ? 0 : std::max(progress_.horizon, options_.steps.value_or(0));
}

/// What follows from clocks and signals must be the same on all ranks: as the first one says.
std::vector<int64_t> Training::Loop::agreed(std::vector<int64_t> mine) const {
  return from_first(*options_.ranks, std::move(mine));
}

bool Training::Loop::finished() {
  const std::vector<int64_t> now =
      agreed({run_.stop && *run_.stop != 0, time_.is_up(saving_.seconds() + step_seconds_), progress_.horizon});
  progress_.horizon = now[2];
  result_.interrupted = now[0];
  result_.out_of_time = now[1] && end() != progress_.step;
  const bool stop_here = options_.stop_after > 0 && progress_.step >= options_.stop_after;
  return result_.interrupted || result_.out_of_time || stop_here || (end() > 0 && progress_.step >= end());
}

void Training::Loop::diverged(const std::string& what) const {
  throw NotFinite(
      text(what, " at step ", progress_.step, "; ",
           saved_step_ > 0 ? text("the checkpoint of step ", saved_step_, " is good") : "no checkpoint was saved",
           "\n  fix: lower the learning rates (config.toml in the run folder lists the settings); "
           "CLOAM_DEBUG=nan names the first op with a value that is not finite"));
}

/// The last checkpoint, and the same steps from there: those that the fault must lie in op by op.
void Training::Loop::go_back(const NotFinite& why) {
  const LoadedCheckpoint checkpoint = load_latest_checkpoint(run_.checkpoints);
  if (checkpoint.step != saved_step_) throw why;
  listener_.warning(text(why.what(), "\n  taking the steps from ", saved_step_, " on again, to find the op"));
  went_back_ = true;
  searched_ = progress_.step;
  progress_ = restore_method(run_.method, checkpoint.file);
  optimiser_ = Optimiser(run_.method.parameters(), run_.method.groups(), *options_.ranks);
  restore_optimiser(optimiser_, checkpoint.file);
  next_look_ = 0;
  save_is_due_ = false;
}

void Training::Loop::step_or_go_back() try {
  const NanSearch search(searched_ > 0 && progress_.step + 1 + kFiniteEvery >= searched_);
  one_step();
  if (searched_ == 0 || progress_.step < searched_) return;
  require_finite();
  listener_.warning(text("step ", searched_, " is finite now: the device or its memory erred the first time\n  fix: ",
                         "cloam selftest checks the device; if this happens again, its results cannot be trusted"));
  searched_ = 0;
} catch (const NotFinite& error) {
  if (went_back_ || saved_step_ < 0) throw;
  go_back(error);
} catch (const Error& error) {  // of the op, where each is looked at
  if (searched_ == 0 || error.fault() != Fault::diverged) throw;
  diverged(text(error.what(), ", when the steps were taken again,"));
}

void Training::Loop::require_finite() {
  if (!optimiser_.finite(run_.method.parameters())) diverged("a parameter became NaN or infinite");
}

void Training::Loop::save() {
  require_finite();
  saved_step_ = progress_.step;
  steps_.gather_moments(optimiser_);
  if (options_.ranks->rank() > 0) return;
  const double before = time_.seconds();
  SafetensorsFile file = checkpoint_of(run_.method, progress_, run_.metadata);
  add_prefixed(file.tensors, optimiser_.state(), kOptimiser);
  result_.checkpoint = save_checkpoint(run_.checkpoints, progress_.step, file);
  saving_.saved(before, time_.seconds());
  listener_.checkpoint(progress_.step, result_.checkpoint);
}

double Training::Loop::learning_rate() const {
  for (const ParameterGroup& group : run_.method.groups())
    if (!group.frozen) return static_cast<double>(group.rate_at(progress_));
  return 0;
}

std::optional<double> Training::Loop::seconds_left() const {
  if (progress_.horizon == 0) return time_.budget_left();
  const int64_t last = options_.stop_after > 0 ? std::min(options_.stop_after, end()) : end();
  const std::optional<double> steps = time_.seconds_to(last, progress_);
  return steps ? std::optional(*steps + saving_.measured()) : std::nullopt;
}

bool Training::Loop::step() {
  if (finished()) return false;
  step_or_go_back();
  const double now = time_.seconds();
  if (progress_.step > warm_after_) time_.add_step(now - told_at_);
  told_at_ = now;
  if (planning_) time_.choose_horizon(progress_, saving_.seconds());
  listener_.step(
      {progress_, end(), result_.loss, time_.seconds(), step_seconds_, learning_rate(), seconds_left(), figures_});
  if (save_is_due_) save();
  return true;
}

void Training::Loop::save_if_not() {
  if (saved_step_ != progress_.step) save();
}

TrainResult Training::Loop::result() const {
  TrainResult result = result_;
  result.step = progress_.step;
  result.horizon = progress_.horizon;
  result.end = end();
  result.seconds = time_.seconds();
  return result;
}

namespace {

void compare_names(const Params& wanted, const TensorMap& found) {
  std::string message;
  for (const auto& [name, p] : wanted)
    if (!found.contains(name)) message += text("\n  missing: ", name);
  for (const auto& [name, t] : found)
    if (!wanted.contains(name)) message += text("\n  not in this model: ", name);
  if (!message.empty())
    throw Error(Fault::data, text("the checkpoint does not fit the model:", message,
                                  "\n  fix: use the preset and settings it was trained with"));
}

int64_t number_in(const SafetensorsFile& file, const std::string& key) {
  const auto found = file.metadata.find(key);
  if (found == file.metadata.end())
    throw Error(Fault::data, text("the checkpoint's metadata has no \"", key, "\": it is not a checkpoint of cloam"));
  try {
    return std::stoll(found->second);
  } catch (const std::exception&) {
    throw Error(Fault::data, text("the checkpoint's metadata has ", key, " = \"", found->second, "\", want a number"));
  }
}

}  // namespace

double steady_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

Training::Training(const TrainRun& run, const TrainOptions& options, const TrainListener& listener)
    : loop_(std::make_unique<Loop>(run, options, listener)) {}
Training::~Training() = default;
bool Training::step() { return loop_->step(); }
void Training::save() { loop_->save_if_not(); }
TrainResult Training::result() const { return loop_->result(); }

TrainResult train(const TrainRun& run, const TrainOptions& options, const TrainListener& listener) {
  Training training(run, options, listener);
  while (training.step()) continue;
  training.save();
  return training.result();
}

TensorMap parameters_in(const SafetensorsFile& checkpoint) { return with_prefix(checkpoint.tensors, kParameter); }

std::string row_steps_name(const std::string& parameter) { return text(kOptimiser, "steps.", parameter); }

TensorMap row_steps_in(const SafetensorsFile& checkpoint) {
  return with_prefix(checkpoint.tensors, row_steps_name(""));
}

SafetensorsFile checkpoint_of(Method& method, const Progress& progress, std::map<std::string, std::string> metadata) {
  SafetensorsFile file;
  for (const auto& [name, p] : method.parameters()) file.tensors[kParameter + name] = named(p);
  add_prefixed(file.tensors, method.state(), kState);
  file.metadata = std::move(metadata);
  file.metadata["step"] = std::to_string(progress.step);
  file.metadata["horizon"] = std::to_string(progress.horizon);
  file.metadata["seed"] = std::to_string(progress.seed);
  return file;
}

void restore_optimiser(Optimiser& optimiser, const SafetensorsFile& checkpoint) {
  optimiser.restore(with_prefix(checkpoint.tensors, kOptimiser));
}

Progress restore_method(Method& method, const SafetensorsFile& checkpoint) {
  const TensorMap stored = parameters_in(checkpoint);
  if (auto* takes = as<TakesShapes>(method)) takes->fit_to(stored);
  compare_names(method.parameters(), stored);
  std::vector<std::pair<Tensor, Tensor>> updates;
  for (auto& [name, p] : method.parameters()) updates.push_back({p, tensor_from(stored, name, p.shape())});
  assign(updates);
  TensorMap state;
  for (const auto& [name, tensor] : with_prefix(checkpoint.tensors, kState))
    state[current_tensor(kState + name)] = tensor;
  method.restore(with_prefix(state, kState));
  Progress progress;
  progress.step = number_in(checkpoint, "step");
  progress.horizon = number_in(checkpoint, "horizon");
  progress.seed = static_cast<uint64_t>(number_in(checkpoint, "seed"));
  return progress;
}

}  // namespace cloam
