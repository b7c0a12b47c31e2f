// The commands. Each adds its parser to the program's and returns what runs when it was named; one file each.
#pragma once
#include "cli/options.h"

namespace cloam {

Command add_train(CLI::App& program);
Command add_eval(CLI::App& program);
Command add_report(CLI::App& program);
Command add_compare(CLI::App& program);
Command add_tables(CLI::App& program);
Command add_distance(CLI::App& program);
Command add_crops(CLI::App& program);
Command add_render(CLI::App& program);
Command add_view(CLI::App& program);
Command add_export(CLI::App& program);
Command add_convert(CLI::App& program);
Command add_generate(CLI::App& program);
Command add_edit(CLI::App& program);
Command add_simulate(CLI::App& program);
Command add_process(CLI::App& program);
Command add_check(CLI::App& program);
Command add_demo(CLI::App& program);
Command add_synth(CLI::App& program);
Command add_info(CLI::App& program);
Command add_doctor(CLI::App& program);
Command add_selftest(CLI::App& program);
Command add_bench(CLI::App& program);
Command add_tune(CLI::App& program);
Command add_config(CLI::App& program);
Command add_completion(CLI::App& program);

/// All commands, in the order in which --help lists them.
std::vector<Command> add_commands(CLI::App& program);

/// Runs the command of these words ("render", "runs/fox", ...) within this program. Its clock (seconds_since_start) and
/// the line in its records are its own. Returns its exit code; errors as the program's faults.
int run_words(const std::vector<std::string>& words);

/// seconds_since_start counts from now on: for a command that another one runs.
void restart_clock();

/// As typed at a prompt, with the program's name in front.
std::string typed(const std::vector<std::string>& words);

}  // namespace cloam
