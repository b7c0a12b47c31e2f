// cloam tune: which of the kernels' variants are fastest on this device, kept for the runs to come.
#include "benchmarks/tune.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "models/io/commit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kExamples[] =
    R"(Measure the kernel variants on this device and keep the fastest. Results stay the same, bit for bit.

Examples:
  cloam tune
  cloam tune matmul
  cloam tune --forget)";

struct Options {
  Common common;
  std::string pattern;
  int rounds = 5;
  bool forget = false;
};

std::string line_of(const TuneResult& result) {
  std::string out = text(result.family, " ", result.size, "\n");
  for (size_t i = 0; i < result.trials.size(); i++) {
    const Trial& trial = result.trials[i];
    char line[200];
    std::snprintf(line, sizeof line, "  %s %5.2fx  %s", i == result.winner ? "*" : " ", trial.ratio,
                  trial.variant->row().c_str());
    out += std::string(line) + (trial.rejected.empty() ? "" : "  rejected: " + trial.rejected) + "\n";
  }
  return out;
}

std::string json_of(const std::vector<TuneResult>& results) {
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
  return out.dump(2) + "\n";
}

int forget(const Common& common) {
  std::error_code problem;
  const bool was = std::filesystem::remove(tuned_file(), problem);
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

int run_command(const Options& options) {
  open_device(options.common);
  if (options.forget) return forget(options.common);
  const auto before = [&](const std::string& what, size_t done, size_t all) {
    say(options.common, text("[", done + 1, "/", all, "] ", what));
  };
  const std::vector<TuneResult> results = tune(op_workloads(), {options.pattern, options.rounds}, before);
  std::vector<Choice> kept;
  for (const TuneResult& result : results) {
    if (!options.common.json) put(line_of(result));
    kept.push_back({result.family, result.size, result.trials[result.winner].variant, "tuned"});
  }
  if (options.common.json) put(json_of(results));
  keep(with_tuned(kept));
  const auto changed = std::count_if(results.begin(), results.end(), [](const TuneResult& r) { return r.winner > 0; });
  say(options.common,
      text(results.size(), " choices, ", changed, " differ from the built-in table; kept in ", tuned_file()));
  return 0;
}

}  // namespace

Command add_tune(CLI::App& program) {
  CLI::App* parser = program.add_subcommand("tune", kExamples);
  const auto options = std::make_shared<Options>();
  parser->add_option("PATTERN", options->pattern, "Only workloads whose name contains this (all)");
  parser->add_option("--rounds", options->rounds, "Alternating rounds per candidate (5)")->check(whole_number(1, 99));
  parser->add_flag("--forget", options->forget, "Delete the choices kept for this device");
  add_common(*parser, options->common);
  return {parser, [=] { return run_command(*options); }};
}

}  // namespace cloam
