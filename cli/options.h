// What all options have in common: how their values are checked, how --help shows them, and what is said of words that
// cannot be taken. CLI11 itself is included in four files alone: it costs each seconds of compiling.
#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "cli/common.h"

namespace CLI {
class App;
class Formatter;
class Option;
class ParseError;
}  // namespace CLI

namespace cloam {

/// What the word after an option must be, or what is made of it.
struct WordCheck;
using Check = std::shared_ptr<const WordCheck>;

/// An option that is declared, to say more of it.
class Option {
 public:
  explicit Option(CLI::Option* option) : option_(option) {}
  Option required() const;
  Option expected(int words) const;
  /// One word each time it is typed: arguments may follow.
  Option one_word() const;
  /// What --help shows for the word, where the value's type would say "N".
  Option shown_as(const char* word) const;
  /// What shells complete the word to, where no check lists the words.
  Option offers(const std::vector<std::string>& words) const;

 private:
  CLI::Option* option_;
};

/// The options of a command, in the order of --help: add("--name", value, "What it is (default)", whole_number(1)).
struct Options {
  CLI::App& parser;

  /// A flag, if it is a bool. options.cpp lists the types that a value may have.
  template <class Value>
  Option operator()(const std::string& name, Value& value, const std::string& help, const Check& check = nullptr) const;
  /// One with or without a word, [NAME] in the help; typed(word) is called when it was typed, "" for none.
  void with_or_without(const std::string& name, const char* word, const std::string& help,
                       const std::function<void(const std::string&)>& typed) const;
  /// "" where it is not typed, `alone` for --name, WORD for --name=WORD. A word behind a blank is another argument.
  void flag_or_word(const std::string& name, const std::string& alone, std::string& value, const std::string& help,
                    const Check& check) const;
  /// The heading of those that follow.
  void group(const char* heading) const;
};

/// A command's parser; `examples` is how its help begins.
CLI::App* add_parser(CLI::App& program, const char* name, const char* examples);

/// A command: `examples` is how its help begins, `declare(options, request)` names the options that fill in a Request,
/// `run(request, common)` gives the exit code.
template <class Request, class Run, class Declare>
Command command(CLI::App& program, const char* name, const char* examples, const Run& run, const Declare& declare) {
  CLI::App* parser = add_parser(program, name, examples);
  const auto request = std::make_shared<Request>();
  const auto common = std::make_shared<Common>();
  declare(Options{*parser}, *request);
  add_common(*parser, *common);
  return {parser, [=] { return run(*request, *common); }};
}

/// --allow-outside of a command that reads captures.
void add_allow_outside(const Options& add, bool& allowed);

/// Whole numbers from `least` to `most`.
Check whole_number(int64_t least, int64_t most = std::numeric_limits<int64_t>::max());
/// Numbers from `least` to `most`.
Check number_from(double least, double most);
/// "5m" and the like, which become seconds.
Check duration();
/// One of these words; others are told the nearest.
Check one_of(const std::vector<std::string>& words);

/// For an option that names a folder: no "-" (nothing is written to stdout), no file, nothing below a file, and no name
/// that is a file's ("orbit.gif") unless it is a folder's already.
Check output_folder();
/// For an option that names a file: no "-", no folder, nothing below a file.
Check output_file();
/// For one that names either: no "-", nothing below a file.
Check output_path();

/// What a check says of a word; "" for one that it takes.
std::string problem_of(const Check& check, std::string word);

/// The file that --format and its name give together: with the format's extension where it has none that is a file's.
/// Fault::usage where they contradict each other. format: as "glb"; empty: what the name says.
fs::path with_format(const fs::path& path, const std::string& format);

/// The words that an option takes, as far as they are known: those of one_of and of Option::offers.
std::vector<std::string> offered(const CLI::Option& option);

/// Lines of --help: N for any number, nothing of how values are checked.
std::shared_ptr<CLI::Formatter> help_format();

/// What is wrong with the words that were typed, and an example of how to do it.
std::string complaint(const CLI::ParseError& error, const CLI::App& program);

}  // namespace cloam
