// Commands by their words.
#include <CLI/CLI.hpp>
#include <algorithm>

#include "cli/commands.h"
#include "runtime/error.h"

namespace cloam {

std::vector<Command> add_commands(CLI::App& program) {
  std::vector<Command> commands;
  program.formatter(help_format());  // before the commands are added: they take it over
  for (const auto add : {add_train,  add_eval,    add_compare,    add_tables, add_distance, add_crops,    add_render,
                         add_export, add_convert, add_generate,   add_edit,   add_view,     add_simulate, add_process,
                         add_check,  add_demo,    add_synth,      add_info,   add_doctor,   add_selftest, add_bench,
                         add_tune,   add_config,  add_completion, add_report}) {
    commands.push_back(add(program));
  }
  return commands;
}

std::string typed(const std::vector<std::string>& words) {
  std::string line = "cloam";
  for (const std::string& word : words) line += " " + quoted(word);
  return line;
}

int run_words(const std::vector<std::string>& words) {
  CLI::App program;
  const std::vector<Command> commands = add_commands(program);
  std::vector<std::string> reversed(words.rbegin(), words.rend());  // as CLI11 takes them
  program.parse(reversed);
  const auto named =
      std::find_if(commands.begin(), commands.end(), [](const Command& c) { return c.parser->parsed(); });
  if (named == commands.end()) throw Error(Fault::internal, "[run_words] there is no command " + typed(words));
  command_line() = typed(words);
  restart_clock();
  return named->run();
}

}  // namespace cloam
