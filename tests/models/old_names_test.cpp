// Runs of earlier versions, whose settings and tensors had other names.
#include "models/train/old_names.h"

#include <doctest/doctest.h>

#include <set>

#include "models/methods/code_set.h"
#include "models/train/trainer.h"
#include "tests/models/worlds.h"

using namespace cloam;

TEST_CASE("a setting's old name sets the new one, and every new name is a setting that there is") {
  Config config;
  const auto method = make_method("diffusion");
  method->configure(config);
  config.set("train.average", "0.5", "test");
  for (const ConfigEntry& entry : config.entries())
    if (entry.key == "train.ema") CHECK(to_string(entry.value) == "0.5");
  std::set<std::string> known;
  for (const std::string& name : method_names()) {
    Config all;
    make_method(name)->configure(all);
    for (const ConfigEntry& entry : all.entries()) known.insert(entry.key);
  }
  for (const char* old :
       {"train.average", "schedule.times", "weight.stray", "train.distortion", "data.least_steps", "growth.most",
        "growth.faint", "growth.small", "growth.large", "growth.from", "image.doublings", "image.side"}) {
    CAPTURE(old);
    CHECK(!known.contains(old));
    CHECK(known.contains(current_setting(old)));
  }
}

TEST_CASE("a run's settings that are gone are left out, but nobody can set them") {
  Config config;
  const auto method = make_method("genassets");
  method->configure(config);
  const std::size_t count = config.entries().size();
  config.restore("beyond.careful_new_logs", "true", "run.json");
  config.restore("beyond.common_code", "false", "run.json");
  CHECK(config.entries().size() == count);
  CHECK_THROWS_WITH_AS(config.restore("beyond.common_code", "true", "run.json"),
                       doctest::Contains("run.json: it was trained with beyond.common_code = true"), Error);
  CHECK_THROWS_AS(config.restore("beyond.field_offset", "true", "run.json"), Error);
  const Scenes scenes;
  const SourceRun source{"old", "genassets", {{"beyond.common_code", "true"}}, {}, scenes, {}, {}};
  CHECK_THROWS_WITH_AS(asset_codes(source, 1), doctest::Contains("old: it was trained with beyond.common_code = true"),
                       Error);
  CHECK_THROWS_WITH_AS(config.set("beyond.careful_new_logs", "true", "--set"), doctest::Contains("there is no setting"),
                       Error);
  CHECK_THROWS_WITH_AS(config.restore("beyond.never", "1", "run.json"), doctest::Contains("there is no setting"),
                       Error);
  config.restore("weight.kl", "0.25", "run.json");
  for (const ConfigEntry& entry : config.entries())
    if (entry.key == "weight.kl") CHECK(to_string(entry.value) == "0.25");
}

TEST_CASE("a checkpoint with tensors under their old names restores the same method") {
  const Worlds worlds;
  const Folder folder;
  const auto method = configured("diffusion", small_settings("diffusion"));
  load_world(*method, worlds);
  TrainOptions options;
  options.steps = 2;
  train({*method, folder.path, {}, nullptr, nullptr}, options, {});
  SafetensorsFile file = load_latest_checkpoint(folder.path).file, before = file;
  before.tensors.clear();
  int renamed = 0;
  for (const auto& [name, tensor] : file.tensors) {
    const bool of_ema = name.starts_with("state.ema.");
    before.tensors[of_ema ? "state.average." + name.substr(10) : name] = tensor;
    renamed += of_ema;
  }
  CHECK(renamed > 10);
  const auto again = configured("diffusion", small_settings("diffusion"));
  load_world(*again, worlds);
  restore_method(*again, before);
  CHECK(again->state() == method->state());
}
