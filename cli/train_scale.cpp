// See train_scale.h.
#include "cli/train_scale.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "models/train/pretended_ranks.h"
#include "models/train/shared_step.h"
#include "models/train/step_pace.h"
#include "models/train/trainer.h"
#include "runtime/error.h"
#include "runtime/tensor.h"

namespace cloam {
namespace {

struct Limit {
  int steps;
  double seconds;
  double least_seconds;  // then they end once their time has settled
};
constexpr Limit kUnmeasured{100, 60, 10};  // they compile kernels, and what a step has to do settles
constexpr Limit kMeasured{60, 25, 25};
constexpr int kLeast = 5;        // steps of either, however long they take
constexpr double kSlower = 1.1;  // than the last third of steps: the third before has not settled

/// Steps as the trainer takes them, growth left out.
class Steps {
 public:
  Steps(TrainJob& job, int64_t ranks)
      : job_(job), pretended_(ranks), steps_({ranks == 1 ? alone() : pretended_, ranks}) {}
  void take(Optimiser& optimiser, Progress& progress) {
    const double before = steady_seconds();
    ++progress.step;
    steps_.take(*job_.method, optimiser, progress);
    job_.method->after_step(progress);
    synchronize();
    seconds_.push_back(steady_seconds() - before);
  }
  void forget() {
    seconds_.clear();
    sent_before_ = pretended_.sent_bytes();
  }
  std::size_t count() const { return seconds_.size(); }
  double mean_seconds() const { return mean_of_largest(seconds_, 1); }
  /// Whether steps became faster no longer.
  bool settled() const {
    const auto third = static_cast<std::ptrdiff_t>(count() / 3);
    const auto sum = [&](std::ptrdiff_t from, std::ptrdiff_t to) {
      return std::accumulate(seconds_.end() - from, seconds_.end() - to, 0.0);
    };
    return third > 0 && sum(2 * third, third) < kSlower * sum(third, 0);
  }
  /// Of the slowest of all ranks, for which the others wait.
  double slowest_seconds() const { return mean_of_largest(seconds_, pretended_.size()); }
  double sent_bytes() const {
    return static_cast<double>(pretended_.sent_bytes() - sent_before_) / static_cast<double>(count());
  }

 private:
  TrainJob& job_;
  PretendedRanks pretended_;
  SharedSteps steps_;
  std::vector<double> seconds_;
  uint64_t sent_before_ = 0;
};

/// Steps of both in turn, so that both have the same to do.
void take_in_turn(Steps& one, Steps& each, Optimiser& optimiser, Progress& progress, const Limit& limit) {
  one.forget();
  each.forget();
  const double begun = steady_seconds();
  const auto is_enough = [&] {
    const double seconds = steady_seconds() - begun;
    return seconds > limit.seconds || (seconds > limit.least_seconds && one.settled());
  };
  for (int i = 0; i < limit.steps && (i < kLeast || !is_enough()); ++i) {
    one.take(optimiser, progress);
    each.take(optimiser, progress);
  }
}

int64_t steps_of(const TrainJob& job) {
  return std::max(last_step(job.record), job.record.horizon == 0 ? job.record.steps.value_or(job.default_steps) : 0);
}

}  // namespace

double parse_link(const std::string& words) {
  std::size_t end = 0;
  double number = 0;
  try {
    number = std::stod(words, &end);
  } catch (const std::exception&) { end = 0; }
  const std::string unit = words.substr(end);
  const std::pair<const char*, double> units[] = {{"Gb", 1e9 / 8}, {"Mb", 1e6 / 8}, {"GB", 1e9}, {"MB", 1e6}};
  for (const auto& [name, bytes] : units)
    if (unit == name && number > 0 && std::isfinite(number)) return number * bytes;
  throw Error(Fault::usage,
              text("--link ", words, ": want a speed such as 100Gb or 800Mb (bits a second), or 12GB (bytes)"));
}

void tell_scale(TrainJob& job, const ScaleQuestion& question, const Common& common, EventLog& log) {
  const int64_t ranks = question.ranks;
  const double speed = parse_link(question.link);
  if (ranks > job.method->most_shares())
    throw Error(Fault::usage, text("--ranks ", ranks, ": its settings split a batch into ", job.method->most_shares(),
                                   " at most\n  fix: fewer ranks, or a larger batch: --set batch.*"));
  Progress progress;
  if (question.resume) progress = restore_method(*job.method, *question.resume);
  Optimiser optimiser(job.method->parameters(), job.method->groups());
  if (question.resume) restore_optimiser(optimiser, *question.resume);
  progress.horizon = steps_of(job);
  const int64_t left = std::max<int64_t>(0, progress.horizon - progress.step);
  progress.seed = job.record.seed;
  Steps one(job, 1), each(job, ranks);
  say(common, text("scale  measures steps: ", kUnmeasured.seconds + kMeasured.seconds, " s at most, or ", 2 * kLeast,
                   " of each where steps are slow"));
  take_in_turn(one, each, optimiser, progress, kUnmeasured);
  take_in_turn(one, each, optimiser, progress, kMeasured);
  // What a rank sends and what it receives go over its link at the same time.
  const double on_link = each.sent_bytes() / speed, step = each.slowest_seconds() + on_link;
  const auto steps = static_cast<double>(left);
  const auto milliseconds = [](double seconds) { return fmt::format("{:.4g} ms", 1e3 * seconds); };
  const double waiting = each.slowest_seconds() - each.mean_seconds();
  say(common, text("scale  1 device: ", milliseconds(one.mean_seconds()), " a step, ",
                   words_for_seconds(steps * one.mean_seconds()), " for ", left, " steps"));
  say(common, text("       ", ranks, " devices: ", milliseconds(step), " a step, ", words_for_seconds(steps * step)));
  say(common, text("       of a step ", milliseconds(each.mean_seconds()), " is work on each, ", milliseconds(waiting),
                   " waiting for the slowest, ", milliseconds(on_link), " for ",
                   words_for_bytes(static_cast<uint64_t>(each.sent_bytes())), " to and fro over ", question.link));
  log.write("scale", {{"ranks", ranks},
                      {"link_bytes_per_second", speed},
                      {"steps", left},
                      {"sent_bytes", each.sent_bytes()},
                      {"one_step_seconds", one.mean_seconds()},
                      {"rank_step_seconds", each.mean_seconds()},
                      {"waiting_seconds", waiting},
                      {"link_seconds", on_link},
                      {"step_seconds", step},
                      {"one_seconds", steps * one.mean_seconds()},
                      {"seconds", steps * step}});
}

}  // namespace cloam
