// Names and labels that come from users and files.
#pragma once
#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "runtime/nearest_name.h"

namespace cloam {

/// ASCII letters alone; others stay as they are.
inline std::string lower_case(std::string word) {
  std::transform(word.begin(), word.end(), word.begin(), [](unsigned char c) { return std::tolower(c); });
  return word;
}

/// The next word of a line, between blanks, tabs and line ends, taken off it; "" if there is none.
inline std::string_view next_word(std::string_view& rest) {
  constexpr std::string_view spaces = " \t\r\n";
  rest.remove_prefix(std::min(rest.find_first_not_of(spaces), rest.size()));
  const std::string_view word = rest.substr(0, rest.find_first_of(spaces));
  rest.remove_prefix(word.size());
  return word;
}

/// The number that the whole word is; nothing for other words.
template <class Number>
std::optional<Number> number_in(std::string_view word) {
  Number number{};
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
  const bool whole = error == std::errc() && end == word.data() + word.size();
  return whole ? std::optional(number) : std::nullopt;
}

/// The finite number that a word is; else Fault::data, which begins with `where`.
double finite_number(std::string_view word, const std::string& where);
/// The first `count` numbers of a text. Fault::data, which begins with `where`, for fewer and for other words.
std::vector<double> first_numbers(std::string_view content, std::size_t count, const std::string& where);

/// "a,b" -> a and b; one empty word for "".
std::vector<std::string> comma_separated(const std::string& list);
/// "a, b, c".
std::string joined(const std::vector<std::string>& words, const std::string& between = ", ");
/// A word as a shell takes it.
std::string quoted(const std::string& word);
/// "600 MB", "1.5 GB".
std::string words_for_bytes(uint64_t bytes);
/// "12s", "3m05s", "1h02m".
std::string words_for_seconds(double seconds);
/// Now, in UTC, as 2024-05-31T12:00:00Z.
std::string time_stamp();

}  // namespace cloam
