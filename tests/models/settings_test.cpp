// No setting of any method takes the program down: a number outside of its range is refused by name, and at either end
// of it the method is made and steps, or says that it needs more memory than there is.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "models/data/read_scene.h"
#include "models/data/synthetic_scene.h"
#include "models/methods/registry.h"
#include "models/train/trainer.h"
#include "runtime/device.h"
#include "runtime/error.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"
#include "tests/models/toy_street.h"

using namespace cloam;

namespace {

/// As long as it lives, the device has so little memory that what is too large is told soon.
struct SmallMemory {
  SmallMemory() { choose_device({.max_bytes = 96 << 20}); }
  ~SmallMemory() { choose_device({}); }
};

/// What a method can be made small with, so that one setting at a time is what is large.
std::map<std::string, std::string> small_settings(const std::string& method) {
  if (method == "nerf")
    return {{"field.levels", "3"}, {"field.log2_rows", "8"},  {"field.finest", "16"},    {"field.width", "16"},
            {"batch.rays", "16"},  {"batch.samples", "256"},  {"occupancy.side", "8"},   {"occupancy.cells", "128"},
            {"field.depth", "2"},  {"field.plane_side", "8"}, {"march.min_step", "0.1"}, {"occupancy.start", "1"}};
  if (method == "splat") return {{"initial", "random"}, {"initial.random", "50"}, {"growth.from", "0"}};
  if (method == "genassets")
    return {
        {"planes.channels", "4"},    {"background.side", "16"},  {"code.side", "4"},         {"code.channels", "4"},
        {"decoder.widths", "8,8"},   {"decoder.middle", "8"},    {"decoder.groups", "4"},    {"field.width", "16"},
        {"image.width", "8"},        {"image.side", "3"},        {"image.blocks", "1"},      {"image.doublings", "1"},
        {"adversarial.widths", "8"}, {"batch.patches", "1"},     {"batch.patch_side", "12"}, {"batch.lidar_rays", "16"},
        {"steps.actor", "0.5"},      {"weight.perceptual", "0"}, {"weight.adversarial", "0"}};
  return {{"unet.base", "16"},    {"unet.multipliers", "1,2"}, {"unet.groups", "4"}, {"unet.blocks", "1"},
          {"code.channels", "2"}, {"code.side", "2"},          {"batch.codes", "4"}};
}

struct Worlds {
  Folder folder;
  Scene photos, street;
  Pixels photo_pixels;
  Worlds() {
    write_synthetic_scene(folder.path / "photos", {3, 1, 16, 3});
    photos = read_scene(folder.path / "photos");
    photo_pixels = load_images(photos, Split::train);
    street = toy_street(folder.path);
    street.actors = {toy_actor("a", {2, 4, 1.5}, 12, 0)};
  }
};

std::unique_ptr<Method> configured(const std::string& name, Config& config) {
  auto method = make_method(name);
  method->configure(config);
  for (const auto& [key, value] : small_settings(name)) config.set(key, value, "test");
  return method;
}

/// Two steps and, for methods that have one, a view. A run is the data of methods with a prior(): they are made alone.
void use(Method& method, const Worlds& worlds) {
  const bool street = method.street() != nullptr;
  const Scene& scene = street ? worlds.street : worlds.photos;
  method.build({scene}, 1);
  (void)method.memory({1000, 1000});
  if (method.prior()) return;
  std::vector<TrainingData> data;
  data.push_back({scene, street ? toy_pixels(scene) : worlds.photo_pixels});
  method.load_data(std::move(data));
  const Folder folder;
  TrainOptions options;
  options.steps = 2;
  train({method, folder.path, {}, nullptr, nullptr}, options, {});
  (void)method.render(view_of(scene.frames.front(), scene.cameras.front(), 0));
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
           {digits(entry, entry.range.least - 1), std::string("nan"), std::string("inf"), std::string("-inf"),
            std::string("1e400"), std::string("99999999999999999999"), std::string("9223372036854775807"),
            std::string("-9223372036854775808"), std::string("1e30x"), std::string("")}) {
        CAPTURE(value);
        const bool large_float = value == "99999999999999999999" || value == "9223372036854775807";
        if (large_float && entry.range.most >= kNoLimit) continue;
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
      for (const double value : {entry.range.least, entry.range.most}) {
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
