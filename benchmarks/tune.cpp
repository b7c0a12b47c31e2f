// Tuning and explaining: both run work and look at the choices it made.
#include "benchmarks/tune.h"

#include <cmath>
#include <cstring>
#include <map>
#include <set>

#include "benchmarks/measure.h"
#include "runtime/error.h"
#include "tests/op_cases/candidates.h"

namespace cloam {
namespace {

constexpr double kWorthwhile = 1.03;  // below, a difference is as likely the machine's mood

/// Medians of each candidate over one workload, taking turns.
std::vector<double> race(const Place& place, const std::vector<Trial>& trials, const Run& run, int rounds) {
  std::vector<std::vector<double>> samples(trials.size());
  std::vector<Sampler> samplers;
  for (const Trial& trial : trials) {
    if (trial.rejected.empty()) prefer(place.first, place.second, *trial.variant, "tried");
    samplers.emplace_back(run);
  }
  for (int round = 0; round < rounds; round++)
    for (size_t i = 0; i < trials.size(); i++) {
      if (!trials[i].rejected.empty()) continue;
      prefer(place.first, place.second, *trials[i].variant, "tried");
      samples[i].push_back(samplers[i].sample());
    }
  std::vector<double> out;
  for (const std::vector<double>& s : samples) out.push_back(median(s));
  return out;
}

void run_races(TuneResult& result, const std::vector<const Workload*>& workloads, int rounds) {
  const Place place{result.family, result.size};
  std::vector<double> sum_of_logs(result.trials.size());
  for (const Workload* workload : workloads) {
    const std::vector<double> ms = race(place, result.trials, workload->prepare(), rounds);
    result.workloads.push_back(workload->name);
    for (size_t i = 0; i < ms.size(); i++)
      if (ms[i] > 0) sum_of_logs[i] += std::log(ms[0] / ms[i]);
  }
  double best = kWorthwhile;
  for (size_t i = 1; i < result.trials.size(); i++) {
    Trial& trial = result.trials[i];
    trial.ratio = std::exp(sum_of_logs[i] / static_cast<double>(workloads.size()));
    if (!trial.rejected.empty() || trial.ratio < best) continue;
    best = trial.ratio;
    result.winner = i;
  }
}

std::vector<Choice> choices_in(const Workload& workload) {
  return choices_of([&] { workload.prepare()(); });
}

std::string describe(const std::vector<Choice>& choices) {
  std::string out;
  if (choices.empty()) out = "  no variants to choose from: generated kernels, or one kernel for all devices\n";
  for (const Choice& choice : choices) {
    out += text("  ", choice.family, ", size class ", choice.size, ": ", choice.variant->row(), "\n    ", choice.why,
                " (device class ", device().device_class == DeviceClass::cpu ? "cpu" : "gpu", "), kernels/",
                choice.variant->stem, ".cl\n");
    for (const Variant* other : candidates(choice.family, choice.size))
      if (other != choice.variant) out += text("    instead of it: ", other->row(), "\n");
  }
  return out;
}

}  // namespace

std::vector<TuneResult> tune(const Workloads& workloads, const TuneOptions& options,
                             const std::function<void(const std::string&, size_t, size_t)>& before) {
  std::map<Place, std::vector<const Workload*>> places;
  for (size_t i = 0; i < workloads.size(); i++) {
    if (workloads[i].name.find(options.pattern) == std::string::npos) continue;
    before("looking at " + workloads[i].name, i, workloads.size());
    for (const Choice& choice : choices_in(workloads[i]))
      if (candidates(choice.family, choice.size).size() > 1)
        places[{choice.family, choice.size}].push_back(&workloads[i]);
  }
  const RowsByPlace rows = places.empty() ? RowsByPlace{} : rows_by_choice();
  std::vector<TuneResult> results;
  for (const auto& [place, timed] : places) {
    before(text("trying ", place.first, " ", place.second), results.size(), places.size());
    TuneResult result{place.first, place.second, {}, {}, 0};
    for (const Variant* variant : candidates(place.first, place.second))
      result.trials.push_back({variant, 1, reject(place, *variant, rows)});
    run_races(result, timed, options.rounds);
    prefer(place.first, place.second, *result.trials[result.winner].variant, result.winner ? "tuned" : "built-in");
    results.push_back(result);
  }
  return results;
}

std::string explain(const std::string& op, const Workloads& workloads) {
  std::vector<std::pair<std::string, std::string>> blocks;  // what is said, and the names it is said of
  const auto add = [&](const std::string& name, const std::vector<Choice>& choices) {
    const std::string said = describe(choices);
    for (auto& [known, names] : blocks)
      if (known == said) return void(names += "\n" + name);
    blocks.push_back({said, name});
  };
  for (const Workload& workload : workloads)
    if (workload.name.find(op) != std::string::npos) add("workload " + workload.name, choices_in(workload));
  for (const OpCase& row : op_cases())
    if (row.op == op) add("row " + row.name(), choices_of([&] { (void)bits_of(row); }));
  std::string out;
  for (const auto& [said, names] : blocks) out += names + "\n" + said;
  return out;
}

}  // namespace cloam
