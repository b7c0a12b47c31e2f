// Settings of a method as data: a method shows each of its settings once, and presets, --set, config.toml and the
// checkpoint all read that.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <variant>
#include <vector>

namespace cloam {

using ConfigValue = std::variant<bool, int64_t, double, std::string>;

/// The least and the largest value of a number.
struct NumberRange {
  double min, max;
};

constexpr double kNoLimit = 1e30;  // numbers beyond are no settings but mistakes
constexpr NumberRange kFromZero = {0, kNoLimit};
constexpr NumberRange kShareBelowOne = {0, 0.9999};
constexpr NumberRange kSteps = {1, 1 << 30}, kStepsOrNone = {0, 1 << 30};
constexpr NumberRange kMetres = {0.001, 1000};  // between samples, of a voxel

/// What a setting of a few words can be.
using KnownWords = std::vector<std::string>;

struct ConfigEntry {
  std::string key, help;
  ConfigValue value;
  NumberRange range = {-kNoLimit, kNoLimit};  // of a number
  KnownWords words = {};                      // of text; none: any
  std::string origin = "default";             // default | preset NAME | file F | --set
};

/// The settings of one method, in the order declared.
class Config {
 public:
  /// Declares a setting and binds it to its variable: a later set() writes the variable too. Numbers have a range
  /// (floats without: from 0 on), so that what is made of them can be made: each alone; what they need together the
  /// memory budget decides.
  void bind(const std::string& key, int& variable, const std::string& help, const NumberRange& range);
  void bind(const std::string& key, float& variable, const std::string& help, const NumberRange& range = kFromZero);
  void bind(const std::string& key, bool& variable, const std::string& help);
  /// Without words: any text.
  void bind(const std::string& key, std::string& variable, const std::string& help, const KnownWords& words = {});
  /// Parses `value` as the type of the setting. Old names are known, too (old_names.h).
  /// Fault::usage for an unknown key (with the nearest one), a bad value, a number outside of its range and a word that
  /// is none of those known.
  void set(const std::string& given, const std::string& value, const std::string& origin);
  /// The same for a setting that a run was trained with: those that are gone (old_names.h) are left out.
  /// Fault::data for one that is gone with a value that this version cannot behave as.
  void restore(const std::string& key, const std::string& value, const std::string& origin);
  const std::vector<ConfigEntry>& entries() const { return entries_; }

 private:
  void add(const ConfigEntry& entry, std::function<void(const ConfigValue&)> write);
  std::vector<ConfigEntry> entries_;
  std::vector<std::function<void(const ConfigValue&)>> writers_;
};

std::string to_string(const ConfigValue& value);

/// "256,128,64" -> the numbers. Fault::usage, naming the setting, for anything but one to twelve whole numbers from 1
/// to 99999.
std::vector<int64_t> whole_numbers(const std::string& setting, const std::string& list);

}  // namespace cloam
