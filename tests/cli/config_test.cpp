// cloam config: what it shows can be read again, and a run's settings make the run again.
#include <doctest/doctest.h>

#include <nlohmann/json.hpp>

#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

std::string output_of(const Words& words) {
  const Outcome outcome = cloam_with(words);
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  return outcome.out;
}

}  // namespace

TEST_CASE("config show gives every value with where it comes from: default, preset, file and --set, in this order") {
  const fs::path file = scratch() / "shown.toml";
  write_text(file, "background = \"random\"\ntrain.rate = 0.5\n");
  const auto json = nlohmann::json::parse(output_of({"config", "show", "nerf", "--preset", "nerf-paper", "--config",
                                                     file.string(), "--set", "train.rate=0.25", "--json"}));
  std::map<std::string, std::pair<nlohmann::json, std::string>> found;
  for (const auto& setting : json.at("settings"))
    found[setting.at("key")] = {setting.at("value"), setting.at("origin")};
  CHECK(found.at("field.kind") == std::pair<nlohmann::json, std::string>("frequency", "preset nerf-paper"));
  CHECK(found.at("background") == std::pair<nlohmann::json, std::string>("random", "file shown.toml"));
  CHECK(found.at("train.rate") == std::pair<nlohmann::json, std::string>(0.25, "--set"));
  CHECK(found.at("batch.rays").second != "");
}

TEST_CASE("config show is a file that --config takes, and a run's config.toml makes the same bytes again") {
  const fs::path file = scratch() / "own-settings.toml", again = scratch() / "reloaded";
  write_text(file, output_of({"config", "show", small_run().string()}));
  CHECK(contains(content_of(file), "# --set: "));  // the origin that the run's own file told
  for (const fs::path& settings : {file, small_run() / "config.toml"}) {
    CHECK(output_of({"config", "diff", small_run().string(), settings.string(), "--exit-code"}) == "");
    output_of({"train", "nerf", small_scene().string(), "-o", again.string(), "--steps", "6", "--save-every", "3",
               "--config", settings.string(), "--overwrite", "--pictures", "off", "-q"});
    CHECK(content_of(again / "ckpt/000006.safetensors") == content_of(small_run() / "ckpt/000006.safetensors"));
    CHECK(output_of({"config", "diff", small_run().string(), again.string(), "--exit-code"}) == "");
  }
}

TEST_CASE("config diff shows what differs and nothing else, and exits 7 if it is asked to") {
  const std::string between = output_of({"config", "diff", "nerf", "nerf-paper"});
  CHECK(contains(between, "field.kind         hash -> frequency  # "));
  CHECK_FALSE(contains(between, "batch.samples"));
  CHECK(cloam_with({"config", "diff", "nerf", "nerf-paper", "--exit-code"}).code == 7);
  const auto json =
      nlohmann::json::parse(output_of({"config", "diff", small_run().string(), stopped_run().string(), "--json"}));
  REQUIRE(json.at("differences").size() == 1);
  CHECK(json.at("differences")[0] == nlohmann::json{{"key", "steps"}, {"a", "6"}, {"b", "40"}});
}
