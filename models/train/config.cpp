// Parsing and binding of settings.
#include "models/train/config.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <sstream>

#include "models/io/words.h"
#include "models/train/old_names.h"
#include "runtime/error.h"

namespace cloam {

void Config::add(const ConfigEntry& entry, std::function<void(const ConfigValue&)> write) {
  entries_.push_back(entry);
  writers_.push_back(std::move(write));
}

namespace {

constexpr std::size_t kShown = 40;     // characters of a bad value
constexpr std::size_t kLongList = 12;  // numbers

/// The double with the fewest digits that is this float: 0.03, not 0.0299999993.
double shortest(float value) {
  char digits[32];
  const char* end = std::to_chars(digits, digits + sizeof digits, value).ptr;
  double out = 0;
  std::from_chars(digits, end, out);
  return out;
}

}  // namespace

void Config::bind(const std::string& key, int& variable, const std::string& help, const NumberRange& range) {
  add({key, help, int64_t{variable}, range},
      [&variable](const ConfigValue& v) { variable = static_cast<int>(std::get<int64_t>(v)); });
}
void Config::bind(const std::string& key, float& variable, const std::string& help, const NumberRange& range) {
  add({key, help, shortest(variable), range},
      [&variable](const ConfigValue& v) { variable = static_cast<float>(std::get<double>(v)); });
}
void Config::bind(const std::string& key, bool& variable, const std::string& help) {
  add({key, help, variable}, [&variable](const ConfigValue& v) { variable = std::get<bool>(v); });
}
void Config::bind(const std::string& key, std::string& variable, const std::string& help, const KnownWords& words) {
  add({key, help, variable, {}, words}, [&variable](const ConfigValue& v) { variable = std::get<std::string>(v); });
}

namespace {

std::string in_digits(double value) {
  return value == std::floor(value) ? std::to_string(static_cast<int64_t>(value)) : to_string(ConfigValue(value));
}

std::string in_words(const NumberRange& range) {
  if (range.max < kNoLimit) return text(" from ", in_digits(range.min), " to ", in_digits(range.max));
  return range.min > -kNoLimit ? text(" of ", in_digits(range.min), " or more") : "";
}

template <class T>
T number(const ConfigEntry& entry, const std::string& value) {
  T out{};
  const char* end = value.data() + value.size();
  const auto [at, error] = std::from_chars(value.data(), end, out);
  const bool within = static_cast<double>(out) >= entry.range.min && static_cast<double>(out) <= entry.range.max;
  if (error != std::errc() || at != end || !within)
    throw Error(Fault::usage, text("setting ", entry.key, ": \"", value.substr(0, kShown), "\", want a ",
                                   std::is_integral_v<T> ? "whole number" : "number", in_words(entry.range)));
  return out;
}

std::string word(const ConfigEntry& entry, const std::string& value) {
  const KnownWords& words = entry.words;
  if (words.empty() || std::find(words.begin(), words.end(), value) != words.end()) return value;
  std::string all = words.front();
  for (size_t i = 1; i < words.size(); ++i) all += (i + 1 < words.size() ? ", " : " or ") + words[i];
  throw Error(Fault::usage, text("setting ", entry.key, ": \"", value.substr(0, kShown), "\", want ", all,
                                 did_you_mean(value, words)));
}

ConfigValue parse(const ConfigEntry& entry, const std::string& value) {
  if (std::holds_alternative<int64_t>(entry.value)) return number<int64_t>(entry, value);
  if (std::holds_alternative<double>(entry.value)) return number<double>(entry, value);
  if (std::holds_alternative<std::string>(entry.value)) return word(entry, value);
  if (value == "true" || value == "on" || value == "1") return true;
  if (value == "false" || value == "off" || value == "0") return false;
  throw Error(Fault::usage, text("setting ", entry.key, ": \"", value.substr(0, kShown), "\", want true or false"));
}

}  // namespace

void Config::set(const std::string& given, const std::string& value, const std::string& origin) {
  const std::string key = current_setting(given);
  const auto found = std::find_if(entries_.begin(), entries_.end(), [&](const ConfigEntry& e) { return e.key == key; });
  if (found == entries_.end()) {
    std::vector<std::string> known;
    for (const ConfigEntry& e : entries_) known.push_back(e.key);
    throw Error(Fault::usage,
                text("there is no setting ", key, did_you_mean(key, known), "\n  cloam config show METHOD lists them"));
  }
  found->value = parse(*found, value);
  found->origin = origin;
  writers_[static_cast<size_t>(found - entries_.begin())](found->value);
}

void Config::restore(const std::string& key, const std::string& value, const std::string& origin) {
  if (!is_gone(key, value, origin)) set(key, value, origin);
}

std::string to_string(const ConfigValue& value) {
  if (const bool* b = std::get_if<bool>(&value)) return *b ? "true" : "false";
  if (const int64_t* i = std::get_if<int64_t>(&value)) return std::to_string(*i);
  if (const double* d = std::get_if<double>(&value)) {
    char digits[32];
    return {digits, std::to_chars(digits, digits + sizeof digits, *d).ptr};
  }
  return std::get<std::string>(value);
}

std::vector<int64_t> whole_numbers(const std::string& setting, const std::string& list) {
  std::vector<int64_t> out;
  std::istringstream in(list);
  for (std::string word; std::getline(in, word, ',');) {
    const bool digits = !word.empty() && word.size() < 6 && word.find_first_not_of("0123456789") == std::string::npos;
    if (!digits || std::stoll(word) < 1)
      throw Error(Fault::usage, text("setting ", setting, ": \"", list, "\", want numbers as 256,128,128,64,64"));
    out.push_back(std::stoll(word));
    if (out.size() > kLongList)
      throw Error(Fault::usage, text("setting ", setting, " has more than ", kLongList, " numbers"));
  }
  if (out.empty()) throw Error(Fault::usage, text("setting ", setting, " is empty, want numbers as 256,128,128,64,64"));
  return out;
}

}  // namespace cloam
