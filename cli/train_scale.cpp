// See train_scale.h.
#include "cli/train_scale.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "models/train/pretended_ranks.h"
#include "models/train/shared_step.h"
#include "models/train/trainer.h"
#include "runtime/error.h"
#include "runtime/tensor.h"

namespace cloam {
namespace {

constexpr int kUnmeasured = 4;         // steps: they compile kernels
constexpr int kLeast = 5, kMost = 40;  // steps that are measured
constexpr double kSeconds = 10;        // for them, about

/// A step of one rank.
struct MeasuredStep {
  double seconds = 0;  // the median
  double sent_bytes = 0;
};

/// Steps as the trainer takes them, growth left out.
MeasuredStep measure(TrainJob& job, Optimiser& optimiser, Progress& progress, int64_t ranks) {
  const PretendedRanks pretended(ranks);
  SharedSteps steps({ranks == 1 ? alone() : pretended, ranks});
  std::vector<double> seconds;
  uint64_t sent = 0;
  const double begun = steady_seconds();
  for (int i = 0; i < kUnmeasured + kMost; ++i) {
    const double before = steady_seconds();
    const uint64_t sent_before = pretended.sent_bytes();
    ++progress.step;
    steps.take(*job.method, optimiser, progress);
    job.method->after_step(progress);
    synchronize();
    if (i < kUnmeasured) continue;
    seconds.push_back(steady_seconds() - before);
    sent += pretended.sent_bytes() - sent_before;
    if (i + 1 >= kUnmeasured + kLeast && steady_seconds() - begun > kSeconds) break;
  }
  const auto count = static_cast<double>(seconds.size());
  std::nth_element(seconds.begin(), seconds.begin() + static_cast<std::ptrdiff_t>(seconds.size() / 2), seconds.end());
  return {seconds[seconds.size() / 2], static_cast<double>(sent) / count};
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

void tell_scale(TrainJob& job, int64_t ranks, const std::string& link, const Common& common, EventLog& log) {
  const double speed = parse_link(link);
  if (ranks > job.method->most_shares())
    throw Error(Fault::usage, text("--ranks ", ranks, ": its settings split a batch into ", job.method->most_shares(),
                                   " at most\n  fix: fewer ranks, or a larger batch: --set batch.*"));
  Optimiser optimiser(job.method->parameters(), job.method->groups());
  Progress progress;
  progress.horizon = steps_of(job);
  progress.seed = job.record.seed;
  const MeasuredStep one = measure(job, optimiser, progress, 1), each = measure(job, optimiser, progress, ranks);
  // What a rank sends and what it receives go over its link at the same time.
  const double on_link = each.sent_bytes / speed, step = each.seconds + on_link;
  const auto steps = static_cast<double>(progress.horizon);
  const auto milliseconds = [](double seconds) { return fmt::format("{:.4g} ms", 1e3 * seconds); };
  say(common, text("scale  1 device: ", milliseconds(one.seconds), " a step, ", words_for_seconds(steps * one.seconds),
                   " for ", progress.horizon, " steps"));
  say(common, text("       ", ranks, " devices: ", milliseconds(step), " a step (", milliseconds(each.seconds),
                   " on each, ", milliseconds(on_link), " on links of ", link, "), ", words_for_seconds(steps * step)));
  say(common, text("       each device sends and receives ", words_for_bytes(static_cast<uint64_t>(each.sent_bytes)),
                   " a step"));
  log.write("scale", {{"ranks", ranks},
                      {"link_bytes_per_second", speed},
                      {"steps", progress.horizon},
                      {"sent_bytes", each.sent_bytes},
                      {"one_step_seconds", one.seconds},
                      {"rank_step_seconds", each.seconds},
                      {"link_seconds", on_link},
                      {"step_seconds", step},
                      {"one_seconds", steps * one.seconds},
                      {"seconds", steps * step}});
}

}  // namespace cloam
