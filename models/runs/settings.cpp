// See settings.h.
#include "models/runs/settings.h"

#include <toml++/toml.h>

#include <sstream>

#include "models/io/bytes.h"
#include "models/train/config.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Settings = std::vector<std::pair<std::string, std::string>>;

constexpr uint64_t kLargest = 1 << 20;

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

}  // namespace

Settings read_settings(const std::filesystem::path& path) {
  Settings settings;
  try {
    collect(toml::parse(content_of(path), path.string()), "", path.string(), settings);
  } catch (const toml::parse_error& error) {
    const auto& place = error.source().begin;
    throw Error(Fault::usage,
                text(path.string(), ", line ", place.line, ", column ", place.column, ": ", error.description()));
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

}  // namespace cloam
