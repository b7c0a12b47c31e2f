// What goes wrong gives one clear message and its exit code, and leaves run folders as they were.
#include <doctest/doctest.h>

#include <functional>
#include <map>
#include <nlohmann/json.hpp>

#include "models/io/checkpoint.h"
#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

void edit(const fs::path& file, const std::function<void(nlohmann::json&)>& change) {
  auto json = json_of(file);
  change(json);
  write_text(file, json.dump());
}

void replace_first(const fs::path& file, const std::string& what, const std::string& with) {
  std::string content = content_of(file);
  content.replace(content.find(what), what.size(), with);
  write_text(file, content);
}

struct BadData {
  const char* name;
  std::function<void(const fs::path& data)> damage;
  const char* told;  // what the message must name
};

const char kFirst[] = "transforms_train.json";

/// An uncompressed 24x24 TGA.
std::string tga() {
  std::string header = {0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 24, 0, 24, 0, 24, 0};
  return header + std::string(24 * 24 * 3, '\x40');
}

const std::vector<BadData>& bad_data() {
  static const std::vector<BadData> rows = {
      {"empty folder",
       [](const fs::path& d) {
         fs::remove_all(d);
         fs::create_directories(d);
       },
       "looked for"},
      {"NaN pose",
       [](const fs::path& d) {
         const auto pose = json_of(d / kFirst)["frames"][0]["transform_matrix"][0][0];
         replace_first(d / kFirst, pose.dump(), "NaN");
       },
       "transform_matrix"},
      {"missing key",
       [](const fs::path& d) { edit(d / kFirst, [](auto& j) { j["frames"][1].erase("transform_matrix"); }); },
       "transform_matrix"},
      {"path that leaves the folder",
       [](const fs::path& d) {
         fs::copy_file(d / "train" / "r_0.png", d.parent_path() / "secret.png", fs::copy_options::overwrite_existing);
         edit(d / kFirst, [](auto& j) { j["frames"][0]["file_path"] = "../secret.png"; });
       },
       "../secret"},
      {"path that leaves the folder to nothing",
       [](const fs::path& d) { edit(d / kFirst, [](auto& j) { j["frames"][0]["file_path"] = "../nothing.png"; }); },
       "../nothing"},
      {"absolute path",
       [](const fs::path& d) { edit(d / kFirst, [](auto& j) { j["frames"][0]["file_path"] = "/etc/hostname"; }); },
       "/etc/hostname"},
      {"truncated training image",
       [](const fs::path& d) { fs::resize_file(d / "train" / "r_3.png", fs::file_size(d / "train" / "r_3.png") / 2); },
       "r_3.png"},
      {"truncated test image",
       [](const fs::path& d) { fs::resize_file(d / "test" / "r_1.png", fs::file_size(d / "test" / "r_1.png") / 2); },
       "r_1.png"},
      {"PNG that is a TGA", [](const fs::path& d) { write_text(d / "train" / "r_2.png", tga()); }, "r_2.png"},
      {"0 frames",
       [](const fs::path& d) {
         edit(d / kFirst, [](auto& j) { j["frames"] = nlohmann::json::array(); });
         fs::remove(d / "transforms_test.json");
       },
       ""},
      {"no JSON", [](const fs::path& d) { write_text(d / kFirst, "{\"frames\": ["); }, "transforms_train.json"},
  };
  return rows;
}

}  // namespace

TEST_CASE("bad data: exit 3, a message that names it, the run folder unchanged") {
  const auto before = snapshot(small_run());
  int index = 0;
  for (const BadData& row : bad_data()) {
    CAPTURE(row.name);
    const fs::path data = copy_of_scene("bad" + std::to_string(index++));
    row.damage(data);
    const Outcome replaced = cloam_with(small_training(data, small_run(), {"--steps", "5", "--overwrite"}));
    CHECK(replaced.code == 3);
    CHECK(replaced.err.find("error: ") == replaced.err.rfind("error: "));
    CHECK_MESSAGE(contains(replaced.err, row.told), replaced.err);
    CHECK(contains(replaced.err, "[exit 3]"));
    CHECK(snapshot(small_run()) == before);
    const Outcome checked = cloam_with({"check", data.string()});
    CHECK_MESSAGE(checked.code == 3, checked.err);
  }
}

TEST_CASE("bad data makes no new run folder") {
  const fs::path data = copy_of_scene("bad-new");
  write_text(data / "train" / "r_2.png", tga());
  CHECK(cloam_with(small_training(data, scratch() / "never", {"--steps", "5"})).code == 3);
  CHECK_FALSE(fs::exists(scratch() / "never"));
}

TEST_CASE("--skip-bad drops a damaged image with a warning and trains on the rest") {
  const fs::path data = copy_of_scene("skipped");
  write_text(data / "train" / "r_2.png", tga());
  const Outcome outcome = cloam_with(small_training(data, scratch() / "skipped-run", {"--steps", "3", "--skip-bad"}));
  CHECK_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(contains(outcome.err, "warning: "));
  CHECK(contains(outcome.err, "r_2.png"));
}

TEST_CASE("a missing image is warned of and skipped") {
  const fs::path data = copy_of_scene("missing");
  fs::remove(data / "train" / "r_5.png");
  const Outcome outcome = cloam_with(small_training(data, scratch() / "missing-run", {"--steps", "3"}));
  CHECK_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(contains(outcome.err, "r_5"));
}

TEST_CASE("wrong checkpoints are exit 3 and nothing is lost") {
  const fs::path run = scratch() / "wrong", other = scratch() / "other-run";
  REQUIRE(cloam_with(small_training(small_scene(), run, {"--steps", "20", "--stop-after", "5"})).code == 0);
  REQUIRE(cloam_with(
              small_training(small_scene(), other, {"--steps", "20", "--stop-after", "5", "--set", "field.levels=2"}))
              .code == 0);
  const fs::path file = run / "ckpt" / "000005.safetensors";
  const std::string sound = content_of(file);
  std::string turned = sound;
  turned[sound.size() - 100] = static_cast<char>(turned[sound.size() - 100] ^ 4);
  SafetensorsFile foreign = read_safetensors(file);
  foreign.metadata["method"] = "splat";
  write_safetensors(file, foreign);
  const std::map<std::string, std::string> wrong = {
      {"cut short", sound.substr(0, sound.size() / 2)},
      {"one bit turned", turned},
      {"no checkpoint at all", "not a checkpoint"},
      {"empty", ""},
      {"of another run", content_of(other / "ckpt" / "000005.safetensors")},
      {"of another method", content_of(file)}};
  for (const auto& [name, bytes] : wrong) {
    write_text(file, bytes);
    const auto before = snapshot(run);
    for (const Words& words : {Words{"train", "--resume", run.string()}, Words{"eval", run.string()},
                               Words{"render", run.string(), "-o", (scratch() / "nothing").string()}}) {
      CAPTURE(name);
      CAPTURE(words[0]);
      const Outcome outcome = cloam_with(words);
      CHECK_MESSAGE(outcome.code == 3, outcome.err);
      CHECK(snapshot(run) == before);
    }
  }
  CHECK_FALSE(fs::exists(scratch() / "nothing"));
  write_text(file, sound);
  CHECK(cloam_with({"train", "--resume", run.string(), "--stop-after", "6", "--pictures", "off"}).code == 0);
}

TEST_CASE("a damaged newest checkpoint is passed over with a warning") {
  const fs::path run = copy_of(small_run(), "fallback");
  fs::resize_file(run / "ckpt" / "000006.safetensors", 1000);
  const Outcome outcome = cloam_with({"eval", run.string(), "--json", "-q"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(nlohmann::json::parse(outcome.out).at("step") == 3);
  CHECK(contains(outcome.err, "warning: "));
}

TEST_CASE("a damaged run.json is exit 3") {
  const fs::path run = copy_of(small_run(), "record");
  write_text(run / "run.json", "{");
  CHECK(cloam_with({"eval", run.string()}).code == 3);
  fs::remove(run / "run.json");
  const Outcome outcome = cloam_with({"eval", run.string()});
  CHECK(outcome.code == 3);
  CHECK(contains(outcome.err, "run.json"));
}

TEST_CASE("no OpenCL driver: exit 4 with the package to install, at once") {
  const Words nowhere = {"OCL_ICD_VENDORS=/nonexistent"};
  const Outcome outcome = cloam_with(small_training(small_scene(), scratch() / "no-device", {}), nowhere);
  CHECK(outcome.code == 4);
  CHECK(contains(outcome.err, "pocl-opencl-icd"));
  CHECK_FALSE(fs::exists(scratch() / "no-device"));
  CHECK(cloam_with({"info"}, nowhere).code == 4);
  CHECK(cloam_with({"eval", small_run().string()}, nowhere).code == 4);
  CHECK(cloam_with({"check", small_scene().string()}, nowhere).code == 0);
}

TEST_CASE("a plan over the memory budget: exit 5 before anything is written") {
  const Outcome outcome = cloam_with(small_training(small_scene(), scratch() / "big", {"--max-memory", "300K"}));
  CHECK_MESSAGE(outcome.code == 5, outcome.err);
  CHECK_FALSE(fs::exists(scratch() / "big"));
}

TEST_CASE("places that cannot be written: exit 8") {
  CHECK(cloam_with(small_training(small_scene(), "/proc/cloam-run", {"--steps", "2"})).code == 8);
  CHECK(cloam_with({"eval", small_run().string(), "--json", "-q", "--images", (scratch() / "i").string()}, {},
                   "/dev/full")
            .code == 8);
}

TEST_CASE("typing errors: exit 2 with the nearest name") {
  struct Row {
    Words words;
    const char* hint;
  };
  const std::string data = small_scene().string();
  for (const Row& row : std::vector<Row>{
           {{"trian", "nerf", data}, "train"},
           {{"train", "nerf", data, "--step", "5"}, "--steps"},
           {{"train", "nerff", data}, "nerf"},
           {{"train", data}, "train nerf"},
           {{"train", "nerf", data, "--preset", "nerf-papr"}, "nerf-paper"},
           {{"train", "nerf", data, "--set", "batch.ray=5"}, "batch.rays"},
           {{"train", "nerf", data, "--set", "batch.rays=many"}, "many"},
           {{"train", "nerf", data, "--set", "batch.rays"}, "key=value"},
           {{"train", "nerf", data, "--progress", "jsonll"}, "jsonl"},
           {{"train", "nerf", data, "--time-budget", "soon"}, "5m"},
           {{"train", "nerf", data, "--max-memory", "lots"}, "6G"},
           {{"train", "nerf", data, "--holdout", "1"}, "--holdout"},
           {{"train", "nerf", data, "--config", "no-such.toml"}, "no-such.toml"},
           {{"train", "nerf", data, data}, "one capture"},
           {{"train"}, "train nerf DATA"},
           {{"train", "--resume"}, "RUN"},
           {{"eval", small_run().string() + "x"}, "precious"},
           {{"render", small_run().string(), "-o", "x", "--path", "orbt"}, "orbit"},
           {{"render", small_run().string()}, "--out"},
       }) {
    std::string line;
    for (const std::string& word : row.words) line += " " + word;
    CAPTURE(line);
    const Outcome outcome = cloam_with(row.words);
    CHECK_MESSAGE(outcome.code == 2, outcome.err);
    CHECK_MESSAGE(contains(outcome.err, row.hint), outcome.err);
    CHECK(outcome.out.empty());
  }
}

TEST_CASE("settings come from preset, file and --set, in this order") {
  const fs::path file = scratch() / "own.toml";
  write_text(file, "batch.rays = 96\n[train]\nrate = 0.02\nfinal_rate = 0.5\n");
  const fs::path run = scratch() / "configured";
  const Outcome outcome = cloam_with(
      small_training(small_scene(), run, {"--steps", "2", "--config", file.string(), "--set", "train.rate=0.005"}));
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  const auto settings = json_of(run / "run.json").at("settings");
  CHECK(settings.at("batch.rays") == "64");  // --set of the small training goes before the file
  CHECK(settings.at("train.rate") == "0.005");
  CHECK(settings.at("train.final_rate") == "0.5");
  CHECK(contains(content_of(run / "config.toml"), "# file own.toml"));
  const Outcome again =
      cloam_with({"train", "nerf", small_scene().string(), "-o", (scratch() / "again").string(), "--steps", "2",
                  "--config", (run / "config.toml").string(), "--pictures", "off", "-q"});
  REQUIRE_MESSAGE(again.code == 0, again.err);
  CHECK(json_of(scratch() / "again" / "run.json").at("settings") == settings);
}

TEST_CASE("the program introduces itself") {
  const Outcome bare = cloam_with({});
  CHECK(bare.code == 0);
  CHECK(contains(bare.out, "cloam train nerf DATA"));
  CHECK(contains(cloam_with({"--version"}).out, "cloam 0."));
  const Outcome help = cloam_with({"train", "--help"});
  CHECK(help.code == 0);
  CHECK(help.out.find("Examples:") < help.out.find("Usage:"));
}

TEST_CASE("info names the device in the spelling that chooses it again") {
  const Outcome outcome = cloam_with({"info", "--json"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  const auto json = nlohmann::json::parse(outcome.out);
  CHECK(json.at("devices").size() >= 1);
  const std::string id = json.at("default");
  const Outcome again = cloam_with({"info", "--json", "--device", id});
  CHECK(nlohmann::json::parse(again.out).at("default") == id);
  CHECK(cloam_with({"info", "--device", "no-such-device"}).code == 4);
}
