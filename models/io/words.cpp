// See words.h.
#include "models/io/words.h"

#include <fmt/chrono.h>

#include <cmath>
#include <ctime>

#include "models/io/safetensors_header.h"
#include "runtime/error.h"

namespace cloam {

double finite_number(std::string_view word, const std::string& where) {
  if (const auto value = number_in<double>(word); value && std::isfinite(*value)) return *value;
  bad_data(where, ": looked for a finite number, found '", printable(word), "'");
}

std::vector<double> first_numbers(std::string_view content, std::size_t count, const std::string& where) {
  std::vector<double> numbers;
  while (numbers.size() < count) {
    const std::string_view word = next_word(content);
    if (word.empty()) bad_data(where, ": looked for ", count, " numbers, found ", numbers.size());
    numbers.push_back(finite_number(word, where));
  }
  return numbers;
}

std::vector<std::string> comma_separated(const std::string& list) {
  std::vector<std::string> words;
  std::size_t begin = 0;
  for (std::size_t end = 0; end != std::string::npos; begin = end + 1) {
    end = list.find(',', begin);
    words.push_back(list.substr(begin, end - begin));
  }
  return words;
}

std::string joined(const std::vector<std::string>& words, const std::string& between) {
  return fmt::format("{}", fmt::join(words, between));
}

std::string quoted(const std::string& word) {
  const char* plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./=:,+@%";
  if (!word.empty() && word.find_first_not_of(plain) == std::string::npos) return word;
  std::string out = "'";
  for (const char c : word) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

std::string words_for_bytes(uint64_t bytes) {
  const double mega = static_cast<double>(bytes) / (1 << 20);
  if (mega >= 1000) return fmt::format("{:.1f} GB", mega / 1024);
  return fmt::format("{:.{}f} MB", mega, mega < 10 ? 1 : 0);
}

std::string words_for_seconds(double seconds) {
  const long whole = std::lround(std::max(0.0, seconds));
  if (whole < 60) return fmt::format("{}s", whole);
  if (whole < 3600) return fmt::format("{}m{:02}s", whole / 60, whole % 60);
  return fmt::format("{}h{:02}m", whole / 3600, whole / 60 % 60);
}

std::string time_stamp() { return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(std::time(nullptr))); }

}  // namespace cloam
