// The commands. Each adds its parser to the program's and returns what runs when it was named; one file each.
#pragma once
#include "cli/common.h"
#include "cli/options.h"

namespace cloam {

Command add_train(CLI::App& program);
Command add_eval(CLI::App& program);
Command add_compare(CLI::App& program);
Command add_distance(CLI::App& program);
Command add_render(CLI::App& program);
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
Command add_selftest(CLI::App& program);
Command add_bench(CLI::App& program);
Command add_tune(CLI::App& program);

}  // namespace cloam
