// What all options have in common: how their values are checked, how --help shows them, and what is said of words that
// cannot be taken.
#pragma once
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace CLI {
class App;
class Formatter;
class ParseError;
class Validator;
}  // namespace CLI

namespace cloam {

/// Whole numbers from `least` to `most`.
CLI::Validator whole_number(int64_t least, int64_t most = std::numeric_limits<int64_t>::max());
/// Numbers from `least` to `most`.
CLI::Validator number_from(double least, double most);
/// One of these words; others are told the nearest.
CLI::Validator one_of(const std::vector<std::string>& words);

/// Lines of --help: N for any number, nothing of how values are checked.
std::shared_ptr<CLI::Formatter> help_format();

/// What is wrong with the words that were typed, and an example of how to do it.
std::string complaint(const CLI::ParseError& error, const CLI::App& program);

}  // namespace cloam
