// cloam config: the settings of methods, presets and runs, how they differ, and the schemas of what commands print.
#include <algorithm>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/schemas.h"
#include "models/io/words.h"
#include "models/methods/registry.h"
#include "models/runs/settings.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kConfigExamples[] =
    R"(Show settings with where each value comes from, how two runs differ, and the schemas of JSON output.

Examples:
  cloam config show nerf                              every setting, as a file for --config of cloam train
  cloam config show genassets --preset genassets-small --set batch.patches=2
  cloam config show runs/fox                          what a run was trained with
  cloam train nerf DATA --config runs/fox/config.toml     ... and another run with it
  cloam config diff runs/a runs/b                     only what differs; also presets and files of settings
  cloam config diff nerf nerf-paper
  cloam config schema                                 the names of the schemas
  cloam config schema eval                            what cloam eval --json prints (JSON Schema, draft 7))";

struct ConfigRequest {
  std::string action;
  std::vector<std::string> names;
  std::string preset;
  SettingsGiven given;
  bool exit_code = false;
};

using Report = nlohmann::ordered_json;

Report value_of(const ConfigValue& value) {
  return std::visit([](const auto& plain) { return Report(plain); }, value);
}

Report head_of(const ResolvedSettings& settings) {
  return {{"name", settings.name}, {"method", settings.method}, {"preset", settings.preset}};
}

void check_count(const ConfigRequest& request, std::size_t least, std::size_t most, const char* example) {
  if (request.names.size() >= least && request.names.size() <= most) return;
  throw Error(Fault::usage,
              text("config ", request.action, " wants ", least == most ? text(least) : text(least, " or ", most),
                   most == 1 ? " name" : " names", ", found ", request.names.size(), "\n  example: ", example));
}

int show(const ConfigRequest& request, const Common& common) {
  check_count(request, 1, 1, "cloam config show nerf");
  const std::string& name = request.preset.empty() ? request.names[0] : request.preset;
  const ResolvedSettings found = resolved_settings(name, request.given, listener_of(common));
  if (!request.preset.empty() && found.method != method_of_alias(request.names[0]))
    throw Error(Fault::usage,
                text("--preset ", request.preset, " belongs to ", found.method, ", not to ", request.names[0],
                     "\n  fix: cloam config show ", found.method, " --preset ", request.preset));
  if (!common.json) {
    put(config_text(found.entries,
                    text("Settings of ", found.method, ", preset ", found.preset, "; use with --config")));
    return 0;
  }
  Report json = {{"schema_version", 1}};
  json.update(head_of(found));
  json["settings"] = Report::array();
  for (const ConfigEntry& entry : found.entries)
    json["settings"].push_back(
        {{"key", entry.key}, {"value", value_of(entry.value)}, {"origin", entry.origin}, {"help", entry.help}});
  put_json(json);
  return 0;
}

bool is_settings_file(const std::string& name) {
  std::error_code error;
  return fs::path(name).extension() == ".toml" || fs::is_regular_file(name, error);
}

/// A file of settings is taken over the defaults of the other's method, or over those of the first method that knows
/// all of its keys.
ResolvedSettings side(const std::string& name, const std::string& other, const Listener& listener) {
  if (!is_settings_file(name)) return resolved_settings(name, {}, listener);
  std::vector<std::string> methods;
  if (!is_settings_file(other)) methods = {resolved_settings(other, {}, listener).method};
  if (methods.empty()) methods = method_names();
  for (const std::string& method : methods) {
    try {
      ResolvedSettings found = resolved_settings(method, {name, {}}, listener);
      found.name = name;
      return found;
    } catch (const Error&) {
      if (method == methods.back()) throw;
    }
  }
  return {};
}

struct Difference {
  std::string key, a, b, help;
};

void add_difference(std::vector<Difference>& all, const Difference& one) {
  if (one.a != one.b) all.push_back(one);
}

std::vector<Difference> differences(const ResolvedSettings& a, const ResolvedSettings& b) {
  std::vector<Difference> all;
  add_difference(all, {"method", a.method, b.method, ""});
  add_difference(all, {"preset", a.preset, b.preset, ""});
  for (const auto& [key, value] : a.run)
    if (b.run.contains(key)) add_difference(all, {key, value, b.run.at(key), ""});
  const auto value_in = [](const ResolvedSettings& settings, const std::string& key) -> std::string {
    for (const ConfigEntry& entry : settings.entries)
      if (entry.key == key) return to_string(entry.value);
    return "(none)";
  };
  for (const ConfigEntry& entry : a.entries)
    add_difference(all, {entry.key, to_string(entry.value), value_in(b, entry.key), entry.help});
  for (const ConfigEntry& entry : b.entries)
    if (value_in(a, entry.key) == "(none)")
      add_difference(all, {entry.key, "(none)", to_string(entry.value), entry.help});
  return all;
}

std::string lines_of(const std::vector<Difference>& all) {
  std::size_t width = 0;
  for (const Difference& one : all) width = std::max(width, one.key.size());
  std::string lines;
  for (const Difference& one : all) {
    const auto shown = [](const std::string& value) { return value.empty() ? std::string("\"\"") : value; };
    lines += one.key + std::string(width - one.key.size(), ' ') + "  " + shown(one.a) + " -> " + shown(one.b) +
             (one.help.empty() ? "" : "  # " + one.help) + "\n";
  }
  return lines;
}

int diff(const ConfigRequest& request, const Common& common) {
  check_count(request, 2, 2, "cloam config diff runs/a runs/b");
  const Listener listener = listener_of(common);
  const ResolvedSettings a = side(request.names[0], request.names[1], listener);
  const ResolvedSettings b = side(request.names[1], request.names[0], listener);
  const std::vector<Difference> found = differences(a, b);
  if (common.json) {
    Report json = {{"schema_version", 1}, {"a", head_of(a)}, {"b", head_of(b)}, {"differences", Report::array()}};
    for (const Difference& one : found) json["differences"].push_back({{"key", one.key}, {"a", one.a}, {"b", one.b}});
    put_json(json);
  } else {
    put(lines_of(found));
    if (found.empty()) say(common, "no difference");
  }
  return request.exit_code && !found.empty() ? static_cast<int>(Fault::verification) : 0;
}

int schema(const ConfigRequest& request, const Common& common) {
  check_count(request, 0, 1, "cloam config schema eval");
  if (!request.names.empty()) {
    put(schema_named(request.names[0]));
    return 0;
  }
  if (common.json) {
    put_json({{"schema_version", 1}, {"schemas", schema_names()}});
    return 0;
  }
  for (const std::string& name : schema_names()) put(name + "\n");
  return 0;
}

int run_config(const ConfigRequest& request, const Common& common) {
  if (request.action == "show") return show(request, common);
  return request.action == "diff" ? diff(request, common) : schema(request, common);
}

}  // namespace

Command add_config(CLI::App& program) {
  return command<ConfigRequest>(
      program, "config", kConfigExamples, run_config, [](const Options& add, ConfigRequest& r) {
        add("ACTION", r.action, "show, diff or schema", one_of({"show", "diff", "schema"})).required();
        add("NAME", r.names, "Methods, presets, run folders or files of settings; a schema");
        add("--preset", r.preset, "With show: a preset of the method").offers(preset_names());
        add("--config", r.given.file, "With show: a TOML file with settings, over the preset");
        add("--set", r.given.settings, "With show: setting key=value, may be repeated").one_word();
        add("--exit-code", r.exit_code, "With diff: exit 7 if there is a difference");
      });
}

}  // namespace cloam
