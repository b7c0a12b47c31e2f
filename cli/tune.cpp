// cloam tune: which of the kernels' variants are fastest on this device, kept for the runs to come.
#include "benchmarks/tune.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "models/io/commit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kTuneExamples[] =
    R"(Measure the kernel variants on this device and keep the fastest. Results stay the same, bit for bit.

Examples:
  cloam tune
  cloam tune matmul
  cloam tune --forget)";

struct TuneRequest {
  std::string pattern;
  int rounds = 5;
  bool forget = false;
};

std::string line_of(const TuneResult& result) {
  std::string out = text(result.family, " ", result.size, "\n");
  for (size_t i = 0; i < result.trials.size(); i++) {
    const Trial& trial = result.trials[i];
    out += fmt::format("  {} {:5.2f}x  {}{}\n", i == result.winner ? "*" : " ", trial.ratio, trial.variant->row(),
                       trial.rejected.empty() ? "" : "  rejected: " + trial.rejected);
  }
  return out;
}

nlohmann::ordered_json json_of(const std::vector<TuneResult>& results) {
  nlohmann::ordered_json out = {{"schema_version", 1}, {"device", device().name}, {"driver", device().driver}};
  out["file"] = tuned_file();
  out["choices"] = nlohmann::ordered_json::array();
  for (const TuneResult& result : results) {
    nlohmann::ordered_json trials = nlohmann::ordered_json::array();
    for (const Trial& trial : result.trials)
      trials.push_back({{"variant", trial.variant->row()}, {"ratio", trial.ratio}, {"rejected", trial.rejected}});
    out["choices"].push_back({{"family", result.family},
                              {"size", result.size},
                              {"workloads", result.workloads},
                              {"trials", trials},
                              {"winner", result.winner}});
  }
  return out;
}

int forget(const Common& common) {
  std::error_code problem;
  const bool was = fs::remove(tuned_file(), problem);
  if (problem) throw Error(Fault::write, text("cannot remove ", tuned_file(), ": ", problem.message()));
  say(common, (was ? "deleted " : "there was no ") + tuned_file());
  return 0;
}

void keep(const std::string& choices) {
  try {
    commit_text(tuned_file(), choices);
  } catch (const Error& error) {
    throw Error(error.fault(),
                text(error.what(), "\n  fix: set CLOAM_CACHE_DIR to another folder for the tuned choices"));
  }
}

int run_tune(const TuneRequest& request, const Common& common) {
  open_device(common);
  if (request.forget) return forget(common);
  const auto before = [&](const std::string& what, size_t done, size_t all) {
    say(common, text("[", done + 1, "/", all, "] ", what));
  };
  const std::vector<TuneResult> results = tune(op_workloads(), {request.pattern, request.rounds}, before);
  std::vector<Choice> kept;
  for (const TuneResult& result : results) {
    if (!common.json) put(line_of(result));
    kept.push_back({result.family, result.size, result.trials[result.winner].variant, "tuned"});
  }
  if (common.json) put_json(json_of(results), 2);
  keep(with_tuned(kept));
  const auto changed = std::count_if(results.begin(), results.end(), [](const TuneResult& r) { return r.winner > 0; });
  say(common, text(results.size(), " choices, ", changed, " differ from the built-in table; kept in ", tuned_file()));
  return 0;
}

}  // namespace

Command add_tune(CLI::App& program) {
  return command<TuneRequest>(program, "tune", kTuneExamples, run_tune, [](const Options& add, TuneRequest& r) {
    add("PATTERN", r.pattern, "Only workloads whose name contains this (all)");
    add("--rounds", r.rounds, "Alternating rounds per candidate (5)", whole_number(1, 99));
    add("--forget", r.forget, "Delete the choices kept for this device");
  });
}

}  // namespace cloam
