// Stage 2 through the program: a run that learns from a run, bytes that repeat, and what cannot be learned from.
#include <doctest/doctest.h>
#include <signal.h>

#include "models/io/safetensors.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

bool contains(const std::string& where, const std::string& what) { return where.find(what) != std::string::npos; }

/// A run of two streets, one of them at night, that has seen most of its actors.
const fs::path& source_run() {
  static const fs::path run = [] {
    const std::string logs = (scratch() / "two_streets").string(), folder = (scratch() / "two_streets_run").string();
    const Outcome made = cloam_with({"synth", "-o", logs, "--logs", "2", "--frames", "3", "--size", "48x27",
                                     "--cameras", "front", "--beams", "24", "--night", "0.5", "-q"});
    REQUIRE_MESSAGE(made.code == 0, made.err);
    Words words = {"train",    "genassets",       logs + "/001", logs + "/002", "-o", folder,
                   "--preset", "genassets-small", "--steps",     "8",           "-q"};
    for (const char* setting :
         {"background.side=32", "batch.patches=2", "batch.patch_side=8", "batch.lidar_rays=32", "code.side=4",
          "code.channels=4", "decoder.middle=16", "decoder.widths=16,8,8", "decoder.groups=4", "weight.perceptual=0"})
      words.insert(words.end(), {"--set", setting});
    const Outcome trained = cloam_with(words);
    REQUIRE_MESSAGE(trained.code == 0, trained.err);
    return fs::path(folder);
  }();
  return run;
}

Words small_diffusion(const fs::path& source, const fs::path& run, const Words& more = {}) {
  Words words = {"train", "diffusion", source.string(), "-o", run.string(), "--preset", "diffusion-small", "-q"};
  for (const char* setting : {"unet.base=8", "unet.groups=4", "batch.codes=8"})
    words.insert(words.end(), {"--set", setting});
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

const Words kSteps = {"--steps", "60", "--save-every", "20"};

/// The run that was left alone.
const fs::path& golden() {
  static const fs::path run = [] {
    const fs::path folder = scratch() / "assets";
    const Outcome trained = cloam_with(small_diffusion(source_run(), folder, kSteps));
    REQUIRE_MESSAGE(trained.code == 0, trained.err);
    return folder;
  }();
  return run;
}

std::string last_checkpoint(const fs::path& run) { return content_of(run / "ckpt" / "000060.safetensors"); }

fs::path copied(const fs::path& run, const std::string& name) {
  const fs::path to = scratch() / name;
  fs::copy(run, to, fs::copy_options::recursive);
  return to;
}

void change_record(const fs::path& run, const std::string& key, const std::string& value) {
  auto record = json_of(run / "run.json");
  record["settings"][key] = value;
  write_text(run / "run.json", record.dump());
}

}  // namespace

TEST_CASE("a run of diffusion records the run it learned from, with its codes' shape as settings") {
  const auto record = json_of(golden() / "run.json");
  CHECK(record.at("method") == "diffusion");
  CHECK(record.at("state") == "finished");
  CHECK(record.at("data").size() == 1);
  CHECK(record.at("data").at(0).at("relative") == "../two_streets_run");
  CHECK(contains(record.at("data").at(0).at("fingerprint"), "genassets, step 8, "));
  CHECK(record.at("settings").at("code.side") == "4");
  CHECK(contains(content_of(golden() / "config.toml"), "code.channels = 4  # run "));
  CHECK(json_of(golden() / "scene.json").at("scenes").size() == 2);
  const std::string events = content_of(golden() / "metrics.jsonl");
  CHECK(contains(events, "codes of 4x4x4 with variance"));
  CHECK(contains(events, "\"event\":\"end\",\"t\":"));
}

TEST_CASE("equal seeds of diffusion give equal bytes, others others") {
  const fs::path same = scratch() / "assets_again", other = scratch() / "assets_other";
  REQUIRE(cloam_with(small_diffusion(source_run(), same, kSteps), {"POCL_MAX_PTHREAD_COUNT=1"}).code == 0);
  CHECK(last_checkpoint(same) == last_checkpoint(golden()));
  REQUIRE(cloam_with(small_diffusion(source_run(), other, {"--steps", "60", "--seed", "7"})).code == 0);
  CHECK(last_checkpoint(other) != last_checkpoint(golden()));
  CHECK_FALSE(contains(last_checkpoint(golden()), scratch().string()));
}

TEST_CASE("a killed run of diffusion that is resumed ends in the bytes of the one left alone") {
  const fs::path run = scratch() / "assets_killed";
  Process process(small_diffusion(source_run(), run, kSteps));
  REQUIRE(wait_for(run / "ckpt" / "000020.safetensors", process));
  process.signal(SIGKILL);
  CHECK(process.wait().code == -SIGKILL);
  const Outcome outcome = cloam_with({"train", "--resume", run.string()});
  CHECK_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(last_checkpoint(run) == last_checkpoint(golden()));
}

TEST_CASE("eval of a run of diffusion measures codes that were held out, beside predicting zero") {
  const Outcome evaluated = cloam_with({"eval", golden().string(), "--json"});
  REQUIRE_MESSAGE(evaluated.code == 0, evaluated.err);
  const auto json = nlohmann::json::parse(evaluated.out);
  CHECK(json.at("protocol") == "held-out-codes");
  CHECK(json.at("codes") >= 1);
  CHECK(json.at("training_codes") > json.at("codes"));
  CHECK(json.at("v_loss") > 0);
  CHECK(json.at("baseline_zero_v_loss") == doctest::Approx(1).epsilon(0.5));
  CHECK(json_of(golden() / "eval" / "eval.json").at("v_loss") == json.at("v_loss"));
  CHECK(cloam_with({"eval", golden().string(), "--protocol", "novel"}).code == 2);
  const Outcome rendered = cloam_with({"render", golden().string(), "-o", (scratch() / "none").string()});
  CHECK(rendered.code == 2);
  CHECK(contains(rendered.err, "cloam generate"));
}

TEST_CASE("what diffusion cannot learn from is one error, and makes no run") {
  const fs::path never = scratch() / "assets_never";
  const auto fails = [&](const fs::path& source, int code, const char* says, const Words& more = {}) {
    const Outcome outcome = cloam_with(small_diffusion(source, never, more));
    CAPTURE(outcome.err);
    CHECK(outcome.code == code);
    CHECK(contains(outcome.err, says));
    CHECK_FALSE(fs::exists(never));
  };
  fails(scratch() / "nothing_here", 2, "there is no run folder");
  fails(small_street(), 3, "no run folder: looked for run.json");
  const fs::path nerf = scratch() / "photo_run";
  REQUIRE(cloam_with(small_training(small_scene(), nerf, {"--steps", "1"})).code == 0);
  fails(nerf, 3, "one of nerf");
  const fs::path planes = copied(source_run(), "planes_run");
  change_record(planes, "decoder.use", "false");
  fails(planes, 3, "decoder.use = false");
  const fs::path empty = copied(source_run(), "empty_streets");
  auto scenes = json_of(empty / "scene.json");
  for (auto& scene : scenes.at("scenes")) scene["actors"] = nlohmann::json::array();
  write_text(empty / "scene.json", scenes.dump());
  fails(empty, 3, "no actor to learn from");
  const fs::path unsaved = copied(source_run(), "unsaved_run");
  fs::remove_all(unsaved / "ckpt");
  fails(unsaved, 3, "no usable checkpoint");
  fails(source_run(), 2, "--holdout goes with captures", {"--holdout", "4"});
  fails(source_run(), 2, "unet.groups", {"--set", "unet.groups=3"});
}

TEST_CASE("a source that is gone or was changed since is told; --data names its new place") {
  const fs::path source = copied(source_run(), "moving_source"), run = scratch() / "assets_moving";
  REQUIRE(cloam_with(small_diffusion(source, run, {"--steps", "6", "--stop-after", "3"})).code == 0);
  const fs::path saved = source / "ckpt" / "000008.safetensors";
  SafetensorsFile changed = read_safetensors(saved);
  changed.tensors.at("param.log0.codes").data[0] ^= std::byte{1};
  write_safetensors(saved, changed);
  for (const Words& words : {Words{"train", "--resume", run.string()}, Words{"eval", run.string()}}) {
    const Outcome outcome = cloam_with(words);
    CAPTURE(outcome.err);
    CHECK(outcome.code == 3);
    CHECK(contains(outcome.err, "genassets, step 8, "));
  }
  fs::remove_all(source);
  const Outcome gone = cloam_with({"eval", run.string()});
  CHECK(gone.code == 3);
  CHECK(contains(gone.err, "is gone"));
  const Outcome moved = cloam_with({"train", "--resume", run.string(), "--data", source_run().string()});
  CHECK_MESSAGE(moved.code == 0, moved.err);
  CHECK(cloam_with({"eval", run.string()}).code == 0);
}
