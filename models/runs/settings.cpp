// See settings.h.
#include "models/runs/settings.h"

#include <toml++/toml.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <sstream>

#include "models/io/bytes.h"
#include "models/io/json.h"
#include "models/io/paths.h"
#include "models/io/words.h"
#include "models/methods/registry.h"
#include "models/runs/restore_run.h"
#include "models/train/mixed_precision.h"
#include "models/train/old_names.h"
#include "models/train/shares_networks.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kLargest = 1 << 20;

/// Settings that an option of train alone decides.
constexpr std::pair<const char*, const char*> kOfOptions[] = {{kNetworksFrozen, "--networks"},
                                                              {kMixedPrecision, "--precision"}};

std::string value_text(const toml::node& node, const std::string& where) {
  if (const auto* value = node.as_string()) return value->get();
  if (const auto* value = node.as_integer()) return to_string(ConfigValue(value->get()));
  if (const auto* value = node.as_floating_point()) return to_string(ConfigValue(value->get()));
  if (const auto* value = node.as_boolean()) return value->get() ? "true" : "false";
  throw Error(Fault::usage, where + ": want a number, a string, true or false");
}

void collect(const toml::table& table, const std::string& prefix, const std::string& where, Settings& settings) {
  for (const auto& [key, node] : table) {
    const std::string name = prefix + std::string(key.str());
    if (const auto* inner = node.as_table())
      collect(*inner, name + ".", where, settings);
    else
      settings.emplace_back(name, value_text(node, where + ", " + name));
  }
}

std::string content_of(const std::filesystem::path& path) {
  try {
    const auto bytes = read_file(path, kLargest);
    return {bytes.begin(), bytes.end()};
  } catch (const Error& error) { throw Error(Fault::usage, error.what()); }
}

/// As Config::set, with a note for names of earlier versions.
void set(Config& config, const std::string& key, const std::string& value, const std::string& origin,
         const Listener& listener) {
  if (current_setting(key) != key) listener.warn(text("the setting ", key, " is now called ", current_setting(key)));
  config.set(key, value, origin);
}

std::string toml_value(const ConfigValue& value) {
  const std::string plain = to_string(value);
  if (std::holds_alternative<std::string>(value)) return Json(plain).dump();
  const bool bare = std::holds_alternative<double>(value) && plain.find_first_of(".en") == std::string::npos;
  return bare ? plain + ".0" : plain;
}

/// Where the settings of a run come from, by the remarks in its config.toml; nothing where that is gone.
std::map<std::string, std::string> origins_in(const fs::path& file) {
  std::map<std::string, std::string> origins;
  if (!is_file(file)) return origins;
  const auto bytes = read_file(file, kLargest);
  std::istringstream lines(std::string(bytes.begin(), bytes.end()));
  for (std::string line; std::getline(lines, line);) {
    const std::size_t equals = line.find(" = "), remark = line.rfind("  # ");
    const std::size_t end = remark == std::string::npos ? remark : line.find(": ", remark);
    if (equals != std::string::npos && end != std::string::npos && equals < remark)
      origins[line.substr(0, equals)] = line.substr(remark + 4, end - remark - 4);
  }
  return origins;
}

ResolvedSettings settings_of_run(const std::string& folder, const SettingsGiven& given, const Listener& listener) {
  const RunRecord record = read_record(folder);
  Config config;
  const auto method = configured_method(record, config);
  std::map<std::string, std::string> origins = origins_in(RunPaths{folder}.config());
  apply_settings(given, config, listener);
  ResolvedSettings found{folder, record.method, record.preset, config.entries(), {}};
  for (ConfigEntry& entry : found.entries)
    if (entry.origin == "run.json" && origins.contains(entry.key)) entry.origin = origins[entry.key];
  const Reading& reading = record.reading;
  found.run = {{"seed", text(record.seed)},
               {"steps", record.steps ? text(*record.steps) : ""},
               {"downscale", text(reading.downscale)},
               {"holdout", text(reading.holdout)},
               {"protocol", reading.protocol.name},
               {"masks", to_string(reading.masks)},
               {"actors", to_string(reading.actors)},
               {"image", reading.image}};
  return found;
}

[[noreturn]] void nothing_named(const std::string& name) {
  std::vector<std::string> names = method_names();
  for (const std::string& preset : preset_names()) names.push_back(preset);
  const std::string near = did_you_mean(name, names);
  throw Error(Fault::usage, text(name, " is no method, preset or run folder",
                                 near.empty() ? did_you_mean_path(name) : near, "\n  methods: ", joined(method_names()),
                                 "\n  a file of settings goes with a method: "
                                 "cloam config show METHOD --config FILE"));
}

ResolvedSettings settings_of_preset(const Preset& preset, const SettingsGiven& given, const Listener& listener) {
  Config config;
  const auto method = make_method(preset.method);
  method->configure(config);
  for (const auto& [key, value] : preset.settings) config.set(key, value, text("preset ", preset.name));
  apply_settings(given, config, listener);
  return {preset.name, preset.method, preset.name, config.entries(), {}};
}

}  // namespace

Settings read_settings(const std::filesystem::path& path) {
  Settings settings;
  try {
    collect(toml::parse(content_of(path), path.string()), "", path.string(), settings);
  } catch (const toml::parse_error& error) {
    const auto& place = error.source().begin;
    throw Error(
        Fault::usage,
        text(path.string(), ", line ", place.line, ", column ", place.column, ": ", error.description(),
             "\n  fix: settings are TOML, one key = value a line; cloam config show METHOD prints such a file"));
  }
  return settings;
}

std::pair<std::string, std::string> split_setting(const std::string& setting) {
  const std::size_t equals = setting.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw Error(Fault::usage, text("--set ", setting, ": want key=value, such as --set train.rate=0.01"));
  }
  return {setting.substr(0, equals), setting.substr(equals + 1)};
}

void apply_settings(const SettingsGiven& given, Config& config, const Listener& listener) {
  if (!given.file.empty()) {
    for (const auto& [key, value] : read_settings(given.file))
      set(config, key, value, "file " + fs::path(given.file).filename().string(), listener);
  }
  for (const std::string& setting : given.settings) {
    const auto [key, value] = split_setting(setting);
    for (const auto& [follows, option] : kOfOptions)
      if (key == follows)
        throw Error(Fault::usage, text("--set ", key, ": it follows from ", option, " alone; leave it out"));
    set(config, key, value, "--set", listener);
  }
}

ResolvedSettings resolved_settings(const std::string& name, const SettingsGiven& given, const Listener& listener) {
  std::error_code error;
  const std::string method = method_of_alias(name);
  for (const Preset& preset : presets())
    if (method == preset.name) return settings_of_preset(preset, given, listener);
  if (fs::is_directory(name, error)) return settings_of_run(name, given, listener);
  nothing_named(name);
}

std::string config_text(const std::vector<ConfigEntry>& entries, const std::string& head) {
  std::string content = "# " + head + "\n";
  for (const ConfigEntry& entry : entries)
    content += text(entry.key, " = ", toml_value(entry.value), "  # ", entry.origin, ": ", entry.help, "\n");
  return content;
}

}  // namespace cloam
