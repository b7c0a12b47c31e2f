// cloam bench: how fast the kernels and training steps are here, against the device's limits and other libraries.
#include <CLI/CLI.hpp>

#include "benchmarks/command.h"
#include "benchmarks/tune.h"
#include "cli/commands.h"
#include "cli/output_path.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kExamples[] =
    R"(Time kernels and training steps against the device's measured limits and other libraries.
Run it on an otherwise idle machine.

Examples:
  cloam bench                                    everything, without other libraries
  cloam bench matmul conv --peers                workloads with these words in their names, beside other libraries
  cloam bench --suite train                      whole training steps
  cloam bench --peers --report docs/performance.md
  cloam bench --explain matmul                   which variant of a kernel runs here, and why)";

struct BenchArguments {
  BenchRequest request;
  std::string suite = "all", explained;
};

Workloads workloads_of(const std::string& suite) {
  Workloads all = suite == "train" ? Workloads() : op_workloads();
  if (suite != "ops")
    for (const Workload& step : step_workloads()) all.push_back(step);
  return all;
}

int explain_command(const std::string& op, const Common& common) {
  open_device(common);
  const std::string found = explain(op, op_workloads());
  if (found.empty())
    throw Error(Fault::usage, text("no workload's name contains \"", op,
                                   "\", and no op has that name\n  names: ", "cloam bench, cloam selftest"));
  put(found);
  return 0;
}

int run_command(const BenchArguments& arguments, const Common& common) {
  if (!arguments.explained.empty()) return explain_command(arguments.explained, common);
  BenchRequest request = arguments.request;
  request.json = common.json;
  request.quiet = common.quiet;
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
  CLI::App* parser = program.add_subcommand("bench", kExamples);
  const auto arguments = std::make_shared<BenchArguments>();
  const auto common = std::make_shared<Common>();
  BenchOptions& options = arguments->request.options;
  parser->add_option("PATTERN", options.patterns, "Parts of workload names (all)");
  parser->add_flag("--peers", options.peers, "Also time other libraries, in turn (those found by the build)");
  parser->add_option("--suite", arguments->suite, "ops, train or all (all)")->check(one_of({"ops", "train", "all"}));
  parser->add_option("--rounds", options.rounds, "Samples per workload (9; 5 for slow ones)")
      ->check(whole_number(1, 1000));
  parser->add_option("--report", arguments->request.report, "Write a Markdown report, with a plot beside it")
      ->check(output_file());
  parser->add_option("--explain", arguments->explained,
                     "Show which kernel variants an operation or workload uses, and why");
  add_common(*parser, *common);
  return {parser, [=] { return run_command(*arguments, *common); }};
}

}  // namespace cloam
