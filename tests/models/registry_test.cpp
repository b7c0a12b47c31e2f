// Presets: each can be set, and the ablations differ from their base by what they are named after and nothing else.
#include "models/methods/registry.h"

#include <doctest/doctest.h>

#include "runtime/error.h"

using namespace cloam;

namespace {

std::map<std::string, std::string> settings_of(const std::string& name) {
  const Preset& preset = find_preset(name);
  const auto method = make_method(preset.method);
  Config config;
  method->configure(config);
  for (const auto& [key, value] : preset.settings) config.set(key, value, name);
  std::map<std::string, std::string> settings;
  for (const ConfigEntry& entry : config.entries()) settings[entry.key] = to_string(entry.value);
  return settings;
}

}  // namespace

TEST_CASE("faithful presets leave out all that goes beyond the paper, and nothing else") {
  for (const char* name : {"genassets", "genassets-small"}) {
    const auto base = settings_of(name), faithful = settings_of(text(name, "-faithful"));
    for (const auto& [key, value] : faithful) {
      CAPTURE(key);
      if (key.starts_with("beyond.")) CHECK((value == "false" && base.at(key) == "true"));
      const bool switched = key.starts_with("beyond.") || key == "actors.symmetric" || key == "weight.line_of_sight" ||
                            key == "weight.adversarial" || key == "weight.kl";
      if (!switched) CHECK(value == base.at(key));
    }
  }
}

TEST_CASE("ablations differ from genassets-small in what they leave out alone") {
  for (const Preset& preset : presets()) CHECK_NOTHROW(settings_of(preset.name));
  const auto base = settings_of("genassets-small");
  CHECK(base.at("code.variational") == "true");
  CHECK(base.at("decoder.use") == "true");
  const std::map<std::string, std::map<std::string, std::string>> ablations = {
      {"nokl", {{"weight.kl", "0"}, {"code.variational", "false"}}},
      {"noperceptual", {{"weight.perceptual", "0"}}},
      {"nodecoder", {{"decoder.use", "false"}, {"actors.symmetric", "false"}}},
      {"unisim",
       {{"decoder.use", "false"},
        {"actors.symmetric", "false"},
        {"shadows", "false"},
        {"steps.background", "0.2"},
        {"steps.sky", "16"},
        {"beyond.linear_lidar", "false"}}}};
  for (const auto& [name, differences] : ablations) {
    CAPTURE(name);
    auto expected = base;
    for (const auto& [key, value] : differences) {
      CHECK(base.at(key) != value);
      expected[key] = value;
    }
    CHECK(settings_of("genassets-small-" + name) == expected);
    CHECK(find_preset("genassets-small-" + name).steps == find_preset("genassets-small").steps);
  }
}

TEST_CASE("a setting of a few words takes each of them and names them and the nearest for any other") {
  Config config;
  std::string kind = "auto", file;
  config.bind("space.kind", kind, "where it is", {"auto", "contract", "ndc"});
  config.bind("file", file, "any text");
  config.set("space.kind", "ndc", "--set");
  CHECK(kind == "ndc");
  config.set("file", "contrast", "--set");
  CHECK(file == "contrast");
  CHECK_THROWS_WITH_AS(config.set("space.kind", "contrast", "--set"),
                       doctest::Contains("setting space.kind: \"contrast\", want auto, contract or ndc"), Error);
  CHECK_THROWS_WITH_AS(config.set("space.kind", "contrast", "--set"), doctest::Contains("contract?"), Error);
  CHECK(kind == "ndc");
}
