// What all options have in common: how their values are checked, how --help shows them, and what is said of words that
// cannot be taken.
#pragma once
#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "cli/common.h"

namespace cloam {

/// The options of a command, in the order of --help: add("--name", value, "What it is (default)", whole_number(1)).
struct Options {
  CLI::App& parser;

  template <class Value>
  CLI::Option* operator()(const std::string& name, Value& value, const std::string& help) const {
    if constexpr (std::is_same_v<Value, bool>)
      return parser.add_flag(name, value, help);
    else
      return parser.add_option(name, value, help);
  }
  template <class Value>
  CLI::Option* operator()(const std::string& name, Value& value, const std::string& help, CLI::Validator check) const {
    return (*this)(name, value, help)->check(std::move(check));
  }
  /// The heading of those that follow.
  void group(const char* heading) const { parser.option_defaults()->group(heading); }
};

/// A command: `examples` is how its help begins, `declare(options, request)` names the options that fill in a Request,
/// `run(request, common)` gives the exit code.
template <class Request, class Run, class Declare>
Command command(CLI::App& program, const char* name, const char* examples, const Run& run, const Declare& declare) {
  CLI::App* parser = program.add_subcommand(name, examples);
  const auto request = std::make_shared<Request>();
  const auto common = std::make_shared<Common>();
  declare(Options{*parser}, *request);
  add_common(*parser, *common);
  return {parser, [=] { return run(*request, *common); }};
}

/// --allow-outside of a command that reads captures.
void add_allow_outside(const Options& add, bool& allowed);

/// Whole numbers from `least` to `most`.
CLI::Validator whole_number(int64_t least, int64_t most = std::numeric_limits<int64_t>::max());
/// Numbers from `least` to `most`.
CLI::Validator number_from(double least, double most);
/// "5m" and the like, which become seconds.
CLI::Validator duration();
/// One of these words; others are told the nearest.
CLI::Validator one_of(const std::vector<std::string>& words);

/// For an option that names a folder: no "-" (nothing is written to stdout), no file, nothing below a file, and no name
/// that is a file's ("orbit.gif") unless it is a folder's already.
CLI::Validator output_folder();
/// For an option that names a file: no "-", no folder, nothing below a file.
CLI::Validator output_file();
/// For one that names either: no "-", nothing below a file.
CLI::Validator output_path();

/// The file that --format and its name give together: with the format's extension where it has none that is a file's.
/// Fault::usage where they contradict each other. format: as "glb"; empty: what the name says.
fs::path with_format(const fs::path& path, const std::string& format);

/// Lines of --help: N for any number, nothing of how values are checked.
std::shared_ptr<CLI::Formatter> help_format();

/// What is wrong with the words that were typed, and an example of how to do it.
std::string complaint(const CLI::ParseError& error, const CLI::App& program);

}  // namespace cloam
