// Ctrl-C in every command that takes long: it is acknowledged, what is complete stays and is told, and no half is left.
#include <doctest/doctest.h>
#include <signal.h>

#include <chrono>
#include <regex>
#include <thread>

#include "models/data/read_scene.h"
#include "models/synth/synthetic_scene.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// What a process says that is asked to stop.
Outcome stopped(Process& process, int signal) {
  process.signal(signal);
  const Outcome outcome = process.wait();
  CHECK_MESSAGE(outcome.code == 128 + signal, outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "\nstopping: finishing this "), outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "; press Ctrl-C again to quit at once\n"), outcome.err);
  return outcome;
}

/// The command, asked to stop once `begun` is there.
Outcome stopped(const Words& words, const fs::path& begun, int signal = SIGINT) {
  Process process(words);
  REQUIRE_MESSAGE(wait_for(begun, process), process.wait().err);
  return stopped(process, signal);
}

/// The number in front of these words of what was said at the end.
int number_before(const Outcome& outcome, const std::string& words) {
  std::smatch match;
  const bool found = std::regex_search(outcome.err, match, std::regex("stopped: (\\d+)" + words));
  REQUIRE_MESSAGE(found, outcome.err);
  return std::stoi(match[1]);
}

int files_in(const fs::path& folder, const std::string& ending) {
  int count = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    count += name.ends_with(ending);
    CHECK_MESSAGE((!entry.is_regular_file() || entry.file_size() > 0), name);
  }
  return count;
}

/// A run of photos with 300 views that are held out.
const fs::path& many_views_run() {
  static const fs::path run = [] {
    const fs::path data = scratch() / "many_views", folder = scratch() / "many_views_run";
    write_synthetic_scene(data, {.train = 4, .test = 300, .size = 16});
    const Outcome trained = cloam_with(small_training(data, folder, {"--steps", "2", "-q"}));
    REQUIRE_MESSAGE(trained.code == 0, trained.err);
    return folder;
  }();
  return run;
}

}  // namespace

TEST_CASE("render that is stopped keeps whole pictures and says how many") {
  for (const int signal : {SIGINT, SIGTERM}) {
    const fs::path out = scratch() / ("stopped-render" + std::to_string(signal));
    const Outcome outcome =
        stopped({"render", many_views_run().string(), "-o", out.string(), "--path", "orbit", "--frames", "9999"},
                out / "orbit_0001.png", signal);
    CHECK(number_before(outcome, " of 9999 pictures are complete in " + out.string()) == files_in(out, ".png"));
    CHECK(files_in(out, ".gif") == 0);
  }
}

TEST_CASE("eval that is stopped writes no metrics") {
  const fs::path out = scratch() / "stopped-eval";
  const Outcome outcome = stopped({"eval", many_views_run().string(), "--images", out.string()}, out / "test_r_1.png");
  CHECK(number_before(outcome, " pictures are complete in " + out.string() + "; no metrics") == files_in(out, ".png"));
  CHECK_FALSE(fs::exists(many_views_run() / "eval" / "eval.json"));
}

TEST_CASE("synth that is stopped leaves whole logs alone") {
  const fs::path out = scratch() / "stopped-synth";
  const Outcome outcome = stopped({"synth", "-o", out.string(), "--logs", "900", "--frames", "2", "--size", "48x27",
                                   "--cameras", "front", "--beams", "4"},
                                  out / "003");
  const int complete = number_before(outcome, " of 900 logs are complete in " + out.string());
  CHECK(complete >= 2);
  int logs = 0;
  for (const auto& entry : fs::directory_iterator(out)) {
    CHECK(read_scene(entry.path()).frames.size() == 2);
    ++logs;
  }
  CHECK(logs == complete);
}

TEST_CASE("simulate that is stopped leaves no half log") {
  const fs::path out = scratch() / "stopped-simulate";
  const Outcome outcome = stopped({"simulate", small_street_run().string(), "-o", out.string(), "--size", "320x180"},
                                  out / "camera" / "front_camera" / "00.jpg");
  CHECK(number_before(outcome, " of 6 images and sweeps were made") > 0);
  CHECK(contains(outcome.err, out.string() + " was incomplete and has been removed"));
  CHECK_FALSE(fs::exists(out));
}

TEST_CASE("generate that is stopped keeps whole assets and says how many") {
  const fs::path out = scratch() / "stopped-generate";
  const Outcome outcome = stopped({"generate", small_diffusion_run().string(), "-o", out.string(), "-n", "900",
                                   "--no-meshes", "--size", "16", "--frames", "2", "--steps", "1"},
                                  out / "asset_001.gif");
  CHECK(number_before(outcome, " of 900 assets are complete in " + out.string()) == files_in(out, ".gif"));
  CHECK_FALSE(fs::exists(out / "generate.json"));
}

TEST_CASE("crops that are stopped are whole, and have no index") {
  const fs::path logs = scratch() / "crop-logs", out = scratch() / "stopped-crops";
  const Outcome made = cloam_with({"synth", "-o", logs.string(), "--logs", "1", "--frames", "12", "--size", "160x90",
                                   "--cameras", "front,front_left", "--beams", "4", "-q"});
  REQUIRE_MESSAGE(made.code == 0, made.err);
  Process process({"crops", (logs / "001").string(), "-o", out.string(), "--size", "1024"});
  REQUIRE_MESSAGE(wait_for(out, process), process.wait().err);
  process.signal(SIGINT);
  const Outcome outcome = process.wait();
  CHECK_MESSAGE(outcome.code == 128 + SIGINT, outcome.err);
  CHECK(number_before(outcome, " crops of \\d+ of 24 images are complete in " + out.string() +
                                   ", without crops.json") == files_in(out, ".png"));
  CHECK_FALSE(fs::exists(out / "crops.json"));
}

TEST_CASE("a training acknowledges Ctrl-C before its step ends") {
  const fs::path run = scratch() / "stopped-train";
  Process process(small_training(small_scene(), run, {"--steps", "100000"}));
  REQUIRE(wait_for(run / "metrics.jsonl", process));
  // The file is there before signals are taken.
  while (process.running() && !contains(content_of(run / "metrics.jsonl"), "\"event\":\"step\""))
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  const Outcome outcome = stopped(process, SIGINT);
  CHECK(outcome.err.find("stopping: ") < outcome.err.find("Continue: cloam train --resume"));
}
