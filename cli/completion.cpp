// cloam completion: scripts for shells and a man page, written from the parsers of the commands themselves.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <functional>

#include "cli/commands.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kCompletionExamples[] =
    R"(Print a script that completes commands, options and their words in a shell, or a man page.

Examples:
  cloam completion bash > ~/.local/share/bash-completion/completions/cloam
  cloam completion zsh > ~/.zfunc/_cloam              # with fpath+=~/.zfunc before compinit
  cloam completion fish > ~/.config/fish/completions/cloam.fish
  cloam completion man > ~/.local/share/man/man1/cloam.1

Open a new shell to use it. Packages put the same files in their places.)";

/// An option as shells and the page show it.
struct OptionEntry {
  std::vector<std::string> names;   // "-o", "--out"
  std::string help, word;           // word: "N", "TEXT", ...; "" for a flag
  std::vector<std::string> offers;  // words that it takes, if they are known
  bool repeats = false;
};

struct CommandEntry {
  std::string name, summary, description;
  std::vector<OptionEntry> options, arguments;
};

OptionEntry entry_of(const CLI::Option& option) {
  OptionEntry entry;
  for (const std::string& name : option.get_snames()) entry.names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) entry.names.push_back("--" + name);
  if (option.get_positional()) entry.names = {option.get_name()};
  entry.help = option.get_description();
  const std::string type = option.get_type_name();  // none: a flag
  if (!type.empty() || !option.get_option_text().empty())
    entry.word = type == "INT" || type == "UINT" || type == "FLOAT" || type == "N" ? "N" : "WORD";
  entry.offers = offered(option);
  entry.repeats = option.get_expected_max() > 1;
  return entry;
}

/// The first sentence.
std::string summary_of(const std::string& description) {
  std::string summary = description.substr(0, description.find("\n\n"));
  std::replace(summary.begin(), summary.end(), '\n', ' ');
  return summary.substr(0, summary.find(". "));
}

CommandEntry entry_of(const CLI::App& command) {
  CommandEntry entry{command.get_name(), "", command.get_description(), {}, {}};
  entry.summary = summary_of(entry.description);
  for (const CLI::Option* option : command.get_options())
    (option->get_positional() ? entry.arguments : entry.options).push_back(entry_of(*option));
  return entry;
}

std::vector<CommandEntry> entries_of(const CLI::App& program) {
  std::vector<CommandEntry> entries;
  for (const CLI::App* command : program.get_subcommands({})) entries.push_back(entry_of(*command));
  return entries;
}

std::vector<std::string> names_of(const std::vector<CommandEntry>& commands) {
  std::vector<std::string> names;
  for (const CommandEntry& command : commands) names.push_back(command.name);
  return names;
}

std::vector<std::string> names_of(const std::vector<OptionEntry>& options) {
  std::vector<std::string> names;
  for (const OptionEntry& option : options) names.insert(names.end(), option.names.begin(), option.names.end());
  return names;
}

/// Within single quotes of a shell.
std::string in_quotes(const std::string& words) {
  std::string out;
  for (const char c : words) out += c == '\'' ? "'\\''" : std::string(1, c);
  return "'" + out + "'";
}

// bash ----------------------------------------------------------------------------------------------------------------

std::string bash_case(const CommandEntry& command) {
  std::string values, offers;
  for (const OptionEntry& option : command.options) {
    if (option.word.empty()) continue;
    const std::string words = option.offers.empty() ? "" : " words=" + in_quotes(joined(option.offers, " "));
    values += "        " + joined(option.names, "|") + ") takes=yes" + words + " ;;\n";
  }
  if (!command.arguments.empty()) offers = joined(command.arguments.front().offers, " ");
  return "    " + command.name + ")\n      options=" + in_quotes(joined(names_of(command.options), " ")) +
         "\n      first=" + in_quotes(offers) + "\n      case $previous in\n" + values + "      esac ;;\n";
}

std::string bash_script(const std::vector<CommandEntry>& commands) {
  std::string cases;
  for (const CommandEntry& command : commands) cases += bash_case(command);
  return R"(# bash completion for cloam; cloam completion bash wrote it.
_cloam() {
  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD-1]} command=${COMP_WORDS[1]}
  local options='' first='' takes='' words=''
  COMPREPLY=()
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W ')" +
         joined(names_of(commands), " ") + R"( help version --help --version' -- "$current"))
    return
  fi
  case $command in
)" + cases +
         "    help) first='" + joined(names_of(commands), " ") + R"(' ;;
  esac
  if [ "$takes" ]; then
    COMPREPLY=($(compgen -W "$words" -- "$current"))
  elif [[ $current == -* ]]; then
    COMPREPLY=($(compgen -W "$options" -- "$current"))
  elif [ "$COMP_CWORD" -eq 2 ]; then
    COMPREPLY=($(compgen -W "$first" -- "$current"))
  fi
}
complete -o bashdefault -o default -F _cloam cloam
)";
}

// zsh -----------------------------------------------------------------------------------------------------------------

/// A description within brackets of _arguments.
std::string zsh_text(const std::string& help) {
  std::string out;
  for (const char c : help) out += std::string(c == '[' || c == ']' || c == ':' || c == '\\' ? "\\" : "") + c;
  return out;
}

std::string zsh_words(const OptionEntry& option) {
  if (option.word == "N") return ":number: ";
  return option.offers.empty() ? ":word:_files" : ":word:(" + joined(option.offers, " ") + ")";
}

std::string zsh_case(const CommandEntry& command) {
  std::string lines;
  for (const OptionEntry& option : command.options)
    for (const std::string& name : option.names)
      lines += " \\\n        " + in_quotes((option.repeats ? "*" : "") + name + "[" + zsh_text(option.help) + "]" +
                                           (option.word.empty() ? "" : zsh_words(option)));
  for (std::size_t i = 0; i < command.arguments.size(); ++i) {
    const OptionEntry& argument = command.arguments[i];
    const std::string place = argument.repeats ? "*" : text(i + 1);
    lines += " \\\n        " + in_quotes(place + zsh_words(argument));
  }
  return "    " + command.name + ")\n      _arguments" + lines + " ;;\n";
}

std::string zsh_script(const std::vector<CommandEntry>& commands) {
  std::string list, cases;
  for (const CommandEntry& command : commands) {
    list += "    " + in_quotes(command.name + ":" + zsh_text(command.summary)) + "\n";
    cases += zsh_case(command);
  }
  return "#compdef cloam\n# zsh completion for cloam; cloam completion zsh wrote it.\n_cloam() {\n  local -a "
         "commands\n  "
         "commands=(\n" +
         list + R"(  )
  if (( CURRENT == 2 )); then
    _describe command commands
    return
  fi
  local command=$words[2]
  shift words
  (( CURRENT-- ))
  case $command in
)" + cases +
         "  esac\n}\nif [ \"$funcstack[1]\" = _cloam ]; then _cloam \"$@\"; else compdef _cloam cloam; fi\n";
}

// fish ----------------------------------------------------------------------------------------------------------------

std::string fish_quotes(const std::string& words) {
  std::string out;
  for (const char c : words) out += std::string(c == '\'' || c == '\\' ? "\\" : "") + c;
  return "'" + out + "'";
}

std::string fish_line(const CommandEntry& command, const OptionEntry& option) {
  std::string line = "complete -c cloam -n '__fish_seen_subcommand_from " + command.name + "'";
  for (const std::string& name : option.names)
    line += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
  if (!option.offers.empty())
    line += " -x -a " + fish_quotes(joined(option.offers, " "));
  else if (!option.word.empty())
    line += option.word == "N" ? " -x" : " -r -F";
  return line + " -d " + fish_quotes(option.help) + "\n";
}

std::string fish_script(const std::vector<CommandEntry>& commands) {
  std::string script = "# fish completion for cloam; cloam completion fish wrote it.\n";
  for (const CommandEntry& command : commands) {
    script += "complete -c cloam -f -n __fish_use_subcommand -a " + command.name + " -d " +
              fish_quotes(command.summary) + "\n";
    for (const OptionEntry& option : command.options) script += fish_line(command, option);
    if (!command.arguments.empty() && !command.arguments.front().offers.empty())
      script += "complete -c cloam -n '__fish_seen_subcommand_from " + command.name + "' -a " +
                fish_quotes(joined(command.arguments.front().offers, " ")) + "\n";
  }
  return script;
}

// man -----------------------------------------------------------------------------------------------------------------

/// Text as roff takes it: no line begins with a control character, and hyphens of options stay hyphens.
std::string roff(const std::string& words) {
  std::string out;
  bool begins = true;
  for (const char c : words) {
    if (begins && (c == '.' || c == '\'')) out += "\\&";
    out += c == '\\' ? "\\e" : c == '-' ? "\\-" : std::string(1, c);
    begins = c == '\n';
  }
  return out;
}

std::string man_option(const OptionEntry& option) {
  std::string names;
  for (const std::string& name : option.names) names += (names.empty() ? "" : ", ") + ("\\fB" + roff(name) + "\\fR");
  return ".TP\n" + names +
         (option.word.empty() || option.names.front()[0] != '-' ? "" : " \\fI" + option.word + "\\fR") + "\n" +
         roff(option.help) + "\n";
}

/// The options that every command has are told once.
bool is_common(const OptionEntry& option, const std::vector<CommandEntry>& commands) {
  return std::all_of(commands.begin(), commands.end(), [&](const CommandEntry& command) {
    return std::any_of(command.options.begin(), command.options.end(), [&](const OptionEntry& other) {
      return other.names == option.names && other.help == option.help;
    });
  });
}

std::string man_command(const CommandEntry& command, const std::vector<CommandEntry>& all) {
  std::string usage = ".SS cloam " + command.name;
  for (const OptionEntry& argument : command.arguments)
    usage += " " + argument.names.front() + (argument.repeats ? " ..." : "");
  std::string page = usage + "\n.nf\n" + roff(command.description) + "\n.fi\n";
  for (const OptionEntry& argument : command.arguments) page += man_option(argument);
  for (const OptionEntry& option : command.options)
    if (!is_common(option, all)) page += man_option(option);
  return page;
}

constexpr char kManEnd[] = R"(.SH EXIT STATUS
.TP
0
done
.TP
1
an internal error
.TP
2
usage: unknown names, wrong settings, an output folder that is in use
.TP
3
data that are damaged, hostile or do not fit
.TP
4
no usable OpenCL device, or one that failed
.TP
5
out of memory, or a plan over the budget
.TP
6
the training diverged; the last good checkpoint is kept
.TP
7
a verification failed
.TP
8
a file cannot be written
.TP
130, 143
stopped by SIGINT or SIGTERM; a training has saved its step
.SH ENVIRONMENT
.TP
CLOAM_DEVICE
like \fB\-\-device\fR
.TP
CLOAM_CACHE_DIR
where tune and selftest keep what they found
.TP
CLOAM_DATA_CACHE
where training keeps what it computed from LiDAR sweeps, or off
.TP
CLOAM_DEBUG
some of kernels, nan, poison, bounds, sync, float64
)";

std::string man_page(const std::vector<CommandEntry>& commands) {
  std::string page =
      ".TH CLOAM 1 \"\" \"cloam " + std::string(kVersion) + "\" \"User Commands\"\n.SH NAME\ncloam \\- " +
      "3D scenes from photos and driving logs, on any OpenCL device\n.SH SYNOPSIS\n.B cloam\n.I COMMAND\n" +
      "[\\fIOPTIONS\\fR]\n.SH COMMANDS\n";
  for (const CommandEntry& command : commands)
    page += ".TP\n\\fB" + command.name + "\\fR\n" + roff(command.summary) + "\n";
  page += ".SH OPTIONS OF EVERY COMMAND\n";
  for (const OptionEntry& option : commands.front().options)
    if (is_common(option, commands)) page += man_option(option);
  page += ".SH EACH COMMAND\n";
  for (const CommandEntry& command : commands) page += man_command(command, commands);
  return page + kManEnd;
}

struct CompletionRequest {
  std::string shell;
};

}  // namespace

Command add_completion(CLI::App& program) {
  const auto run = [&program](const CompletionRequest& request, const Common&) {
    const std::vector<CommandEntry> commands = entries_of(program);
    put(request.shell == "bash"   ? bash_script(commands)
        : request.shell == "zsh"  ? zsh_script(commands)
        : request.shell == "fish" ? fish_script(commands)
                                  : man_page(commands));
    return 0;
  };
  return command<CompletionRequest>(
      program, "completion", kCompletionExamples, run, [](const Options& add, CompletionRequest& r) {
        add("SHELL", r.shell, "bash, zsh, fish, or man", one_of({"bash", "zsh", "fish", "man"})).required();
      });
}

}  // namespace cloam
