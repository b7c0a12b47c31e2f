// Training through the program: bytes that repeat, runs that are killed and go on, folders that nothing harms.
#include <doctest/doctest.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "models/io/commit.h"
#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

const Words kSteps = {"--steps", "40", "--save-every", "10"};

std::string checkpoint(const fs::path& run, const char* step) {
  return content_of(run / "ckpt" / (std::string(step) + ".safetensors"));
}

/// The run that was left alone, which all others are held against.
const fs::path& golden() {
  static const fs::path run = [] {
    const fs::path folder = scratch() / "golden";
    Words words = kSteps;
    words.insert(words.end(), {"--pictures", "on"});  // the others have none
    REQUIRE(cloam_with(small_training(small_scene(), folder, words)).code == 0);
    return folder;
  }();
  return run;
}

Outcome resume(const fs::path& run, const Words& more = {}) {
  Words words = {"train", "--resume", run.string(), "--progress", "plain"};
  words.insert(words.end(), more.begin(), more.end());
  return cloam_with(without_pictures(words));
}

std::string state_of(const fs::path& run) { return json_of(run / "run.json").at("state"); }

}  // namespace

TEST_CASE("a run folder holds the record, the settings, the log and the last three checkpoints") {
  const auto record = json_of(golden() / "run.json");
  CHECK(record.at("state") == "finished");
  CHECK(record.at("step") == 40);
  CHECK(record.at("seed") == 42);
  CHECK(record.at("data").at(0).at("relative") == "../scene");
  CHECK(record.at("settings").at("batch.rays") == "64");
  CHECK(contains(content_of(golden() / "config.toml"), "batch.rays = 64  # --set"));
  CHECK_FALSE(fs::exists(golden() / "ckpt" / "000010.safetensors"));
  for (const char* step : {"000020", "000030", "000040"}) CHECK(!checkpoint(golden(), step).empty());
  CHECK(fs::exists(golden() / "preview" / "step_000040.png"));
  CHECK_FALSE(fs::exists(golden() / ".lock"));
}

TEST_CASE("equal seeds give equal bytes, whatever the thread count; other seeds others") {
  const std::string wanted = checkpoint(golden(), "000040");
  for (const char* threads : {"1", "2"}) {
    CAPTURE(threads);
    const fs::path run = scratch() / (std::string("threads") + threads);
    const auto outcome =
        cloam_with(small_training(small_scene(), run, kSteps), {std::string("POCL_MAX_PTHREAD_COUNT=") + threads});
    REQUIRE(outcome.code == 0);
    CHECK(checkpoint(run, "000040") == wanted);
  }
  const fs::path other = scratch() / "seed7";
  REQUIRE(cloam_with(small_training(small_scene(), other, {"--steps", "40", "--seed", "7"})).code == 0);
  CHECK(checkpoint(other, "000040") != wanted);
}

TEST_CASE("a checkpoint holds no path and no device name") {
  const std::string bytes = checkpoint(golden(), "000040");
  CHECK_FALSE(contains(bytes, scratch().string()));
  CHECK_FALSE(contains(bytes, json_of(golden() / "run.json").at("device")));
}

TEST_CASE("a killed run that is resumed ends in the bytes of the one left alone") {
  const fs::path run = scratch() / "killed";
  Process process(small_training(small_scene(), run, kSteps));
  REQUIRE(wait_for(run / "ckpt" / "000010.safetensors", process));
  process.signal(SIGKILL);
  CHECK(process.wait().code == -SIGKILL);
  CHECK(state_of(run) == "running");
  const Outcome outcome = resume(run);
  CHECK_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(checkpoint(run, "000040") == checkpoint(golden(), "000040"));
  CHECK(state_of(run) == "finished");
}

TEST_CASE("a run that was killed before its first checkpoint starts anew") {
  const fs::path run = scratch() / "killed-early";
  Process process(small_training(small_scene(), run, kSteps));
  REQUIRE(wait_for(run / "metrics.jsonl", process));
  process.signal(SIGKILL);
  process.wait();
  if (fs::exists(run / "ckpt" / "latest.txt")) return;  // it was quicker than the kill
  const Outcome outcome = resume(run);
  CHECK_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(checkpoint(run, "000040") == checkpoint(golden(), "000040"));
}

TEST_CASE("SIGINT and SIGTERM finish the step, save and say how to go on") {
  for (const int number : {SIGINT, SIGTERM}) {
    CAPTURE(number);
    const fs::path run = scratch() / ("signal" + std::to_string(number));
    Process process(small_training(small_scene(), run, {"--steps", "100000"}));
    REQUIRE(wait_for(run / "metrics.jsonl", process));
    std::this_thread::sleep_for(std::chrono::milliseconds(500));  // some steps on
    process.signal(number);
    process.signal(number);  // as `timeout` does: once for the process, once for its group
    const Outcome outcome = process.wait();
    CHECK(outcome.code == 128 + number);
    CHECK(contains(outcome.err, "Continue: cloam train --resume " + run.string()));
    CHECK(state_of(run) == "interrupted");
    const auto before = json_of(run / "run.json").at("step").get<int64_t>();
    const Outcome further = resume(run, {"--stop-after", std::to_string(before + 3)});
    CHECK_MESSAGE(further.code == 0, further.err);
    CHECK(json_of(run / "run.json").at("step") == before + 3);
    CHECK(state_of(run) == "stopped");
  }
}

TEST_CASE(
    "a run that was stopped before its occupancy grid began is measured as its preview was, and goes on the same") {
  const fs::path run = scratch() / "stopped-early";
  Words words = kSteps;
  words.insert(words.end(), {"--stop-after", "6", "--pictures", "on"});
  REQUIRE(cloam_with(small_training(small_scene(), run, words)).code == 0);
  std::istringstream events(content_of(run / "metrics.jsonl"));
  double psnr = 0;  // of the preview
  for (std::string line; std::getline(events, line);)
    if (const auto event = nlohmann::json::parse(line); event.at("event") == "eval") psnr = event.at("psnr");
  REQUIRE(psnr > 0);
  REQUIRE(cloam_with({"eval", run.string(), "-q"}).code == 0);
  CHECK(json_of(run / "eval" / "eval.json").at("per_image").at(0).at("psnr").get<double>() == doctest::Approx(psnr));
  const Outcome outcome = resume(run);
  CHECK_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(checkpoint(run, "000040") == checkpoint(golden(), "000040"));
}

TEST_CASE("--stop-after only stops: going on ends in the same bytes") {
  const fs::path run = scratch() / "stopped";
  Words words = kSteps;
  words.insert(words.end(), {"--stop-after", "17"});
  REQUIRE(cloam_with(small_training(small_scene(), run, words)).code == 0);
  CHECK(json_of(run / "run.json").at("step") == 17);
  CHECK(json_of(run / "run.json").at("horizon") == 40);
  // The whole command again with --resume is taken as well as `train --resume RUN`.
  words = kSteps;
  words.push_back("--resume");
  const Outcome outcome = cloam_with(small_training(small_scene(), run, words));
  CHECK_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(checkpoint(run, "000040") == checkpoint(golden(), "000040"));
}

TEST_CASE("a resumed run refuses options that contradict it") {
  const fs::path run = stopped_run();
  const auto before = snapshot(run);
  for (const Words& more : {Words{"--seed", "3"}, Words{"--downscale", "2"}, Words{"--set", "batch.rays=65"},
                            Words{"--steps", "50"}, Words{"--overwrite"}}) {
    CAPTURE(more[0]);
    CHECK(resume(run, more).code == 2);
    CHECK(snapshot(run) == before);
  }
}

TEST_CASE("a time budget is kept and chooses the steps") {
  const fs::path run = scratch() / "budget";
  const Outcome outcome = cloam_with(small_training(small_scene(), run, {"--time-budget", "5s"}));
  REQUIRE(outcome.code == 0);
  CHECK(json_of(run / "run.json").at("step").get<int>() > 10);
}

TEST_CASE("an existing run is refused and unchanged; --overwrite replaces it; a finished one has nothing left to do") {
  const fs::path run = copy_of(small_run(), "existing");
  const auto before = snapshot(run);
  const Outcome refused = cloam_with(small_training(small_scene(), run, {"--steps", "7"}));
  CHECK(refused.code == 2);
  CHECK(contains(refused.err, "finished at step 6"));
  CHECK(snapshot(run) == before);
  const Outcome resumed = resume(run);
  CHECK(resumed.code == 0);
  CHECK(contains(resumed.err, "nothing to do"));
  CHECK(snapshot(run) == before);
  CHECK(cloam_with(small_training(small_scene(), run, {"--steps", "7", "--overwrite"})).code == 0);
  CHECK(json_of(run / "run.json").at("step") == 7);
  CHECK_FALSE(fs::exists(run / "ckpt" / "000006.safetensors"));
}

TEST_CASE("a finished run is extended by --steps, at the final values of its schedules") {
  const fs::path run = copy_of(golden(), "extended"), other = copy_of(golden(), "extended-twice");
  const Outcome refused = resume(run, {"--steps", "30"});
  CHECK(refused.code == 2);
  CHECK(contains(refused.err, "40 steps"));
  CHECK(contains(resume(run, {"--steps", "40"}).err, "nothing to do"));
  REQUIRE(resume(run, {"--steps", "60"}).code == 0);
  CHECK(state_of(run) == "finished");
  CHECK(json_of(run / "run.json").at("step") == 60);
  CHECK(json_of(run / "run.json").at("horizon") == 40);
  CHECK(contains(resume(run).err, "nothing to do"));
  REQUIRE(resume(other, {"--steps", "60", "--stop-after", "50"}).code == 0);
  CHECK(state_of(other) == "stopped");
  REQUIRE(resume(other).code == 0);  // it knows where it was to end
  CHECK(checkpoint(run, "000060") == checkpoint(other, "000060"));
}

TEST_CASE("a folder with other files is never written to, not even with --overwrite") {
  const fs::path folder = scratch() / "other-files";
  fs::create_directories(folder);
  write_text(folder / "thesis.txt", "years of work");
  const auto before = snapshot(folder);
  CHECK(cloam_with(small_training(small_scene(), folder, {"--steps", "5", "--overwrite"})).code == 2);
  CHECK(snapshot(folder) == before);
}

TEST_CASE("a run folder belongs to one process at a time") {
  const fs::path run = scratch() / "held";
  const FolderLock lock(run);
  const Outcome outcome = cloam_with(small_training(small_scene(), run, {"--steps", "5"}));
  CHECK(outcome.code == 2);
  CHECK(contains(outcome.err, "in use by process"));
}

TEST_CASE("a dry run shows the plan and writes nothing") {
  const fs::path run = scratch() / "dry";
  const Outcome outcome = cloam_with(small_training(small_scene(), run, {"--dry-run"}));
  CHECK(outcome.code == 0);
  CHECK(contains(outcome.err, "10 images 24x24"));
  CHECK(contains(outcome.err, "memory "));
  CHECK(contains(outcome.err, "parameters "));
  CHECK_FALSE(fs::exists(run));
}

TEST_CASE("events for programs are JSON lines, one kind after the other") {
  const fs::path run = scratch() / "events";
  Words words = small_training(small_scene(), run, {"--steps", "6", "--save-every", "3"});
  std::replace(words.begin(), words.end(), std::string("plain"), std::string("jsonl"));
  const Outcome outcome = cloam_with(words);
  REQUIRE(outcome.code == 0);
  std::istringstream lines(outcome.out);
  Words kinds;
  for (std::string line; std::getline(lines, line);) {
    const auto event = nlohmann::json::parse(line);
    CHECK(event.at("schema_version") == 1);
    kinds.push_back(event.at("event"));
  }
  REQUIRE(kinds.size() > 6);
  CHECK(kinds[0] == "plan");
  CHECK(kinds[1] == "start");
  CHECK(kinds[2] == "step");
  CHECK(std::count(kinds.begin(), kinds.end(), "checkpoint") == 2);
  CHECK(kinds.back() == "end");
  CHECK(content_of(run / "metrics.jsonl") == outcome.out);
}

TEST_CASE("run and data can be moved together, and data alone with --data") {
  const fs::path place = scratch() / "place", moved = scratch() / "moved";
  fs::create_directories(place);
  fs::copy(small_scene(), place / "photos", fs::copy_options::recursive);
  REQUIRE(cloam_with(small_training(place / "photos", place / "run", {"--steps", "40", "--stop-after", "5"})).code ==
          0);
  fs::rename(place, moved);
  CHECK(resume(moved / "run", {"--stop-after", "8"}).code == 0);
  fs::rename(moved / "photos", moved / "elsewhere");
  const Outcome lost = resume(moved / "run", {"--stop-after", "9"});
  CHECK(lost.code == 3);
  CHECK(contains(lost.err, "--data"));
  CHECK(resume(moved / "run", {"--stop-after", "9", "--data", (moved / "elsewhere").string()}).code == 0);
  CHECK(resume(moved / "run", {"--stop-after", "10"}).code == 0);  // the new place was noted
}

TEST_CASE("a run goes on with its own data alone: other data are exit 3, and nothing is changed") {
  const fs::path run = stopped_run(), other = copy_of_scene("other-photos");
  fs::remove(other / "train" / "r_0.png");
  fs::copy_file(other / "train" / "r_1.png", other / "train" / "r_0.png");
  const auto before = snapshot(run);
  for (const Words& words : {Words{"train", "--resume", run.string(), "--data", other.string()},
                             Words{"train", "nerf", other.string(), "-o", run.string(), "--resume"}}) {
    const Outcome refused = cloam_with(words);
    CHECK(refused.code == 3);
    CHECK(contains(refused.err, "other-photos"));
    CHECK(contains(refused.err, "another run"));
    CHECK(snapshot(run) == before);
  }
}

TEST_CASE("data that were moved are measured by the run's own split; a finished run notes their new place") {
  const fs::path place = scratch() / "finished-place", run = scratch() / "finished-run";
  fs::copy(small_scene(), place, fs::copy_options::recursive);
  REQUIRE(cloam_with(small_training(place, run, {"--steps", "5", "--holdout", "5"})).code == 0);
  REQUIRE(cloam_with({"eval", run.string(), "-q"}).code == 0);
  const auto wanted = json_of(run / "eval" / "eval.json");
  CHECK(wanted.at("protocol") == "holdout-5");
  const fs::path moved = scratch() / "finished-moved";
  fs::rename(place, moved);
  CHECK(cloam_with({"eval", run.string(), "-q"}).code == 3);
  const Outcome there = cloam_with({"eval", run.string(), "--data", moved.string()});
  CHECK_MESSAGE(there.code == 0, there.err);
  CHECK(contains(there.err, "holdout-5"));
  const auto found = json_of(run / "eval" / "eval.json");
  for (const char* key : {"protocol", "images", "psnr", "ssim", "baseline_nearest_frame_psnr"}) {
    CAPTURE(key);
    CHECK(found.at(key) == wanted.at(key));
  }
  const Outcome other = resume(run, {"--data", small_scene().string()});  // the same photos: the same data
  CHECK(other.code == 0);
  CHECK(json_of(run / "run.json").at("data").at(0).at("relative") == "../scene");
  const Outcome noted = resume(run, {"--data", moved.string()});
  CHECK(noted.code == 0);
  CHECK(contains(noted.err, "finished-moved"));
  CHECK(cloam_with({"eval", run.string(), "-q"}).code == 0);
  // One photo less at the front: by the same rule others are held out, which the run was trained on.
  fs::rename(moved / "train" / "r_0.png", scratch() / "r_0.png");
  const Outcome changed = cloam_with({"eval", run.string()});
  CHECK(contains(changed.err, "of the 2 evaluated images were used in training"));
  fs::rename(scratch() / "r_0.png", moved / "train" / "r_0.png");
  const auto before = snapshot(run);
  const fs::path damaged = copy_of_scene("finished-damaged");
  fs::remove(damaged / "train" / "r_0.png");
  CHECK(resume(run, {"--data", damaged.string()}).code == 3);
  CHECK(snapshot(run) == before);
}
