// Settings as files and command lines give them, and those that a method, a preset or a run has in the end.
#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "models/runs/listener.h"
#include "models/train/config.h"

namespace cloam {

using Settings = std::vector<std::pair<std::string, std::string>>;

/// The keys of a TOML file with their values as --set would take them; tables become dotted keys. Fault::usage for a
/// file that cannot be read, is no TOML (with line and column), or holds lists or dates.
Settings read_settings(const std::filesystem::path& path);

/// "key=value" -> both. Fault::usage.
std::pair<std::string, std::string> split_setting(const std::string& setting);

/// What is set over a preset: the file ("" for none), then each key=value.
struct SettingsGiven {
  std::string file;
  std::vector<std::string> settings;
};

/// Fault::usage for unknown keys and wrong values. Tells names of earlier versions.
void apply_settings(const SettingsGiven& given, Config& config, const Listener& listener);

/// All settings of a method, with where each value comes from.
struct ResolvedSettings {
  std::string name;  // as it was asked for
  std::string method, preset;
  std::vector<ConfigEntry> entries;        // in the method's order
  std::map<std::string, std::string> run;  // of a run: seed, steps, how its data are read
};

/// `name`: a method, a preset or a run folder. Fault::usage for any other, with the nearest one; errors of read_record
/// and of apply_settings.
ResolvedSettings resolved_settings(const std::string& name, const SettingsGiven& given, const Listener& listener);

/// As a file that --config takes: each value with where it comes from and what it means.
std::string config_text(const std::vector<ConfigEntry>& entries, const std::string& head);

}  // namespace cloam
