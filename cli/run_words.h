// Commands by their words: for the program, and for commands that run others.
#pragma once
#include <string>
#include <vector>

#include "cli/commands.h"

namespace cloam {

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
