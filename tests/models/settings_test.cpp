// No setting of any method takes the program down: a number outside of its range is refused by name, and at either end
// of it the method is made and steps, or says that it needs more memory than there is.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "runtime/device.h"
#include "runtime/error.h"
#include "tests/models/errors.h"
#include "tests/models/worlds.h"

using namespace cloam;

namespace {

/// As long as it lives, the device has so little memory that what is too large is told soon.
struct SmallMemory {
  SmallMemory() { choose_device({.max_bytes = 96 << 20}); }
  ~SmallMemory() { choose_device({}); }
};

std::unique_ptr<Method> configured(const std::string& name, Config& config) {
  auto method = make_method(name);
  method->configure(config);
  for (const auto& [key, value] : small_settings(name)) config.set(key, value, "test");
  return method;
}

/// Two steps and, for methods that have one, a view.
void use(Method& method, const Worlds& worlds) {
  load_world(method, worlds);
  (void)method.memory({1000, 1000});
  const Folder folder;
  TrainOptions options;
  options.steps = 2;
  train({method, folder.path, {}, nullptr, nullptr}, options, {});
  const Scene& scene = worlds.scene_of(method);
  if (as<RendersViews>(method)) (void)shown(method, view_of(scene.frames.front(), scene.cameras.front(), 0));
}

/// "" where all is well; else what came that is no fault of settings or memory.
std::string outcome(const std::string& name, const std::string& key, const std::string& value, const Worlds& worlds) {
  try {
    Config config;
    const auto method = configured(name, config);
    config.set(key, value, "test");
    use(*method, worlds);
  } catch (const Error& error) {
    if (error.fault() == Fault::internal) return error.what();
  } catch (const std::exception& error) { return std::string("no error of ours: ") + error.what(); }
  return "";
}

std::string digits(const ConfigEntry& entry, double value) {
  return std::holds_alternative<int64_t>(entry.value) ? std::to_string(static_cast<int64_t>(value))
                                                      : to_string(ConfigValue(value));
}

std::vector<ConfigEntry> numbers_of(const std::string& name) {
  Config config;
  const auto method = configured(name, config);
  std::vector<ConfigEntry> numbers;
  for (const ConfigEntry& entry : config.entries())
    if (std::holds_alternative<int64_t>(entry.value) || std::holds_alternative<double>(entry.value))
      numbers.push_back(entry);
  return numbers;
}

}  // namespace

TEST_CASE("a number outside of a setting's range is refused by name, whatever the setting") {
  for (const std::string& name : method_names()) {
    for (const ConfigEntry& entry : numbers_of(name)) {
      CAPTURE(entry.key);
      Config config;
      const auto method = configured(name, config);
      for (const std::string& value :
           {digits(entry, entry.range.min - 1), std::string("nan"), std::string("inf"), std::string("-inf"),
            std::string("1e400"), std::string("99999999999999999999"), std::string("9223372036854775807"),
            std::string("-9223372036854775808"), std::string("1e30x"), std::string("")}) {
        CAPTURE(value);
        const bool large_float = value == "99999999999999999999" || value == "9223372036854775807";
        if (large_float && entry.range.max >= kNoLimit) continue;
        const std::string error = error_of([&] { config.set(entry.key, value, "test"); }, Fault::usage);
        CHECK(holds(error, entry.key));
        CHECK(holds(error, "want a "));
      }
    }
  }
}

TEST_CASE("at either end of a setting's range a method steps, or says what it cannot have") {
  const SmallMemory memory;
  const Worlds worlds;
  for (const std::string& name : method_names()) {
    for (const ConfigEntry& entry : numbers_of(name)) {
      for (const double value : {entry.range.min, entry.range.max}) {
        CAPTURE(name);
        CAPTURE(entry.key);
        CAPTURE(value);
        CHECK(outcome(name, entry.key, digits(entry, value), worlds) == "");
      }
    }
  }
}

TEST_CASE("lists among the settings are checked as numbers are") {
  for (const auto& [name, key] :
       {std::pair("genassets", "decoder.widths"), std::pair("genassets", "adversarial.widths"),
        std::pair("diffusion", "unet.multipliers")}) {
    for (const char* value :
         {"", "0", "-1", "1,,2", "8,99999999999999999999", "1e3", "nan", "8,8,8,8,8,8,8,8,8,8,8,8,8"}) {
      CAPTURE(key);
      CAPTURE(value);
      Config config;
      const auto method = configured(name, config);
      config.set(key, value, "test");
      if (std::string(key) == "adversarial.widths") config.set("weight.adversarial", "0.001", "test");
      CHECK(holds(error_of([&] { method->build({toy_street("/nonexistent", {.lidar = false})}, 1); }, Fault::usage),
                  key));
    }
  }
}
