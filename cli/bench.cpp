// cloam bench: how fast the kernels and training steps are here, against the device's limits and other libraries.

#include "benchmarks/command.h"
#include "benchmarks/tune.h"
#include "cli/bench_merge.h"
#include "cli/commands.h"
#include "models/io/commit.h"
#include "models/io/words.h"
#include "runtime/error.h"
#include "tests/op_cases/op_cases.h"

namespace cloam {
namespace {

constexpr char kBenchExamples[] =
    R"(Time kernels and training steps against the device's measured limits and other libraries.
Run it on an otherwise idle machine.

Examples:
  cloam bench                                    everything, without other libraries
  cloam bench matmul conv --peers                workloads with these words in their names, beside other libraries
  cloam bench --suite train                      whole training steps
  cloam bench --peers --report docs/performance.md
  cloam bench --explain matmul                   which variant of a kernel runs here, and why
  cloam bench --json --budget 5m > this.json     for programs: as many workloads as fit five minutes
  cloam bench --merge this.json other.json       devices side by side, from what --json wrote on each)";

struct BenchArguments {
  BenchRequest request;
  std::string suite = "all", explained, budget;
  std::vector<std::string> merged;
};

Workloads workloads_of(const std::string& suite) {
  Workloads all = suite == "train" ? Workloads() : op_workloads();
  if (suite != "ops")
    for (const Workload& step : step_workloads()) all.push_back(step);
  return all;
}

std::vector<std::string> op_names() {
  std::vector<std::string> names;
  for (const OpCase& row : op_cases()) names.push_back(row.op);
  return names;
}

int explain_command(const std::string& op, const Common& common) {
  open_device(common);
  const std::string found = explain(op, op_workloads());
  if (found.empty())
    throw Error(Fault::usage, text("no workload's name contains \"", op, "\", and no op has that name",
                                   did_you_mean(op, op_names()), "\n  names: ", "cloam bench, cloam selftest"));
  put(found);
  return 0;
}

int merge_command(const BenchArguments& arguments) {
  const std::string page = merged_page(arguments.merged);
  if (arguments.request.report.empty())
    put(page);
  else
    commit_text(arguments.request.report, page);
  return 0;
}

int run_bench_command(const BenchArguments& arguments, const Common& common) {
  if (!arguments.merged.empty()) return merge_command(arguments);
  if (!arguments.explained.empty()) return explain_command(arguments.explained, common);
  BenchRequest request = arguments.request;
  request.json = common.json;
  request.quiet = common.quiet;
  if (!arguments.budget.empty()) request.options.budget_seconds = parse_duration(arguments.budget);
  const Workloads all = workloads_of(arguments.suite);
  (void)chosen_workloads(all, request.options.patterns);
  open_device(common);
  const std::string pinning = device().pinning.empty() ? "" : ", " + device().pinning;
  say(common, text("device ", device().name, " (", device().platform, ")", pinning));
  bench_command(all, request);
  return 0;
}

}  // namespace

Command add_bench(CLI::App& program) {
  return command<BenchArguments>(
      program, "bench", kBenchExamples, run_bench_command, [](const Options& add, BenchArguments& r) {
        BenchOptions& options = r.request.options;
        add("PATTERN", options.patterns, "Parts of workload names (all)");
        add("--peers", options.peers, "Also time other libraries, in turn (those found by the build)");
        add("--filter", options.patterns, "The same as PATTERN").one_word();
        add("--budget", r.budget, "Begin no further workload after this time (90s, 5m)", duration());
        add("--suite", r.suite, "ops, train or all (all)", one_of({"ops", "train", "all"}));
        add("--rounds", options.rounds, "Samples per workload (9; 5 for slow ones)", whole_number(1, 1000));
        add("--report", r.request.report, "Write a Markdown report, with a plot beside it", output_file());
        add("--merge", r.merged, "Compare devices: files that --json wrote, one a device");
        add("--explain", r.explained, "Show which kernel variants an operation or workload uses, and why");
      });
}

}  // namespace cloam
