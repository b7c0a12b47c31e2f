// cloam tables at the least sizes: killed and stopped on the way it comes to the same bytes, it goes on with what is
// new, and a command that fails ends nothing but what needs it.
#include <doctest/doctest.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "tests/cli/mpirun.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// A log that trains (001), and one that is measured (002).
const fs::path& logs() {
  static const fs::path folder = [] {
    const Outcome made =
        cloam_with({"synth", "-o", (scratch() / "table-logs").string(), "--logs", "2", "--frames", "6", "--size",
                    "48x27", "--cameras", "front", "--beams", "12", "--night", "0", "--no-truth", "-q"});
    REQUIRE_MESSAGE(made.code == 0, made.err);
    return scratch() / "table-logs";
  }();
  return folder;
}

Words tables(const fs::path& out, const Words& more = {}) {
  Words words = {
      "tables", "-o", out.string(), "--size", "small", "--protocols", "sparse", "--train", (logs() / "001").string()};
  for (const char* setting :
       {"background.side=32", "batch.patches=1", "batch.patch_side=8", "batch.lidar_rays=32", "code.side=4",
        "code.channels=4", "decoder.middle=16", "decoder.widths=16,8,8", "decoder.groups=4", "weight.perceptual=0"})
    words.insert(words.end(), {"--set", setting});
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

Words usual(const fs::path& out, const Words& more = {}) {
  Words words = tables(out, {"--rows", "full", "--measure", (logs() / "002").string(), "--steps", "train=60,fit=60"});
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

/// Left alone from beginning to end, made once: to be read, or copied.
const fs::path& undisturbed() {
  static const fs::path folder = [] {
    const Outcome outcome = cloam_with(usual(scratch() / "tables"));
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    return scratch() / "tables";
  }();
  return folder;
}

void end_at(const fs::path& begun, const Words& words, int signal, int code) {
  Process process(words);
  REQUIRE_MESSAGE(wait_for(begun, process), process.wait().err);
  process.signal(signal);
  const Outcome outcome = process.wait();
  CHECK_MESSAGE(outcome.code == code, outcome.err);
}

}  // namespace

TEST_CASE("tables that are killed and stopped on the way come to the same bytes of figures") {
  const fs::path out = scratch() / "killed-tables";
  const fs::path fit = out / "fit/full/1/002/sparse";
  end_at(out / "train/full/1/metrics.jsonl", usual(out), SIGKILL, -SIGKILL);
  end_at(fit / "metrics.jsonl", usual(out), SIGINT, 128 + SIGINT);
  CHECK(json_of(fit / "run.json").at("state") == "interrupted");
  const auto step = json_of(fit / "run.json").at("step").get<int>();
  CHECK(step < 60);
  CHECK(json_of(out / "tables.json").at("tables").empty());  // told, also of what is not there yet
  end_at(out / "measure/full/1/002/sparse/images", usual(out), SIGKILL, -SIGKILL);
  CHECK_FALSE(fs::exists(out / "measure/full/1/002/sparse/eval.json"));
  const Outcome last = cloam_with(usual(out));
  CHECK_MESSAGE(last.code == 0, last.err);
  CHECK(contains(last.err, "[3/3] measure/full/1/002/sparse"));
  CHECK_FALSE(contains(last.err, "[1/3]"));  // what is done is not done again
  for (const char* file : {"tables.json", "tables.md"})
    CHECK_MESSAGE(content_of(out / file) == content_of(undisturbed() / file), file);
}

TEST_CASE("tables whose commands run side by side come to the same bytes, and a stop ends all that run") {
  const fs::path out = scratch() / "parallel-tables";
  const Words words = usual(out, {"--seeds", "1,2", "--jobs", "2"});
  {
    Process process(words);
    for (const char* run : {"train/full/1", "train/full/2"})  // both have begun before either has ended
      REQUIRE_MESSAGE(wait_for(out / run / "metrics.jsonl", process), process.wait().err);
    CHECK_FALSE(fs::exists(out / "fit"));
    process.signal(SIGINT);
    CHECK(process.wait().code == 128 + SIGINT);
  }
  for (const char* run : {"train/full/1", "train/full/2"})
    CHECK_MESSAGE(json_of(out / run / "run.json").at("state") == "interrupted", run);
  const Outcome last = cloam_with(words);
  REQUIRE_MESSAGE(last.code == 0, last.err);
  const auto here = snapshot(out), alone = snapshot(undisturbed());
  for (const char* folder : {"train/full/1/ckpt/", "fit/full/1/002/sparse/ckpt/"}) {
    int compared = 0;
    for (const auto& [file, bytes] : alone) {
      if (!file.starts_with(folder)) continue;
      ++compared;
      CHECK_MESSAGE(here.contains(file), file);
      if (here.contains(file)) CHECK_MESSAGE(here.at(file) == bytes, file);
    }
    CHECK_MESSAGE(compared > 0, folder);
  }
  const fs::path measured = "measure/full/1/002/sparse/eval.json";
  CHECK(json_of(out / measured).at("psnr") == json_of(undisturbed() / measured).at("psnr"));
  CHECK(json_of(out / "tables.json").at("missing").empty());
}

TEST_CASE(
    "tables whose commands ranks share come to what one process leaves, and a stop or a death ends all that run") {
  const fs::path alone = copy_of(undisturbed(), "tables-alone"), out = scratch() / "tables-of-ranks";
  REQUIRE(cloam_with(usual(alone, {"--seeds", "1,2"})).code == 0);  // with what is new: the other seed's
  const Words words = usual(out, {"--seeds", "1,2"});
  const auto both_train = [&](Ranks& ranks) {  // both have begun before either has ended
    const auto begun = [&](const char* run) {
      return fs::exists(out / run / "metrics.jsonl") && json_of(out / run / "run.json").at("state") == "running";
    };
    for (int i = 0; i < 600 && ranks.running() && !(begun("train/full/1") && begun("train/full/2")); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    REQUIRE_MESSAGE(ranks.running(), ranks.wait().err);
    CHECK_FALSE(fs::exists(out / "fit"));
  };
  {
    Ranks ranks(2, words);
    both_train(ranks);
    for (const pid_t process : ranks.processes()) REQUIRE(kill(process, SIGUSR1) == 0);
    const Outcome stopped = ranks.wait();
    CHECK(stopped.code == 128 + SIGUSR1);
    CHECK_MESSAGE(contains(stopped.err, "stopped: 0 of 6 commands are done"), stopped.err);
  }
  for (const char* run : {"train/full/1", "train/full/2"})
    CHECK_MESSAGE(json_of(out / run / "run.json").at("state") == "interrupted", run);
  {
    Ranks ranks(2, words);
    both_train(ranks);
    const pid_t lost = ranks.process_of(1);
    REQUIRE(lost > 0);
    REQUIRE(kill(lost, SIGKILL) == 0);
    CHECK(ranks.wait().code != 0);
  }
  const Outcome last = Ranks(2, words).wait();
  REQUIRE_MESSAGE(last.code == 0, last.err);
  CHECK(contains(last.err, "[6/6] measure/full/2/002/sparse"));
  for (const char* file : {"tables.json", "tables.md"})
    CHECK_MESSAGE(content_of(out / file) == content_of(alone / file), file);
  const auto here = snapshot(out);
  int compared = 0;
  for (const auto& [file, bytes] : snapshot(alone)) {
    if (!contains(file, "/ckpt/")) continue;
    ++compared;
    CHECK_MESSAGE(here.at(file) == bytes, file);
  }
  CHECK(compared >= 8);
}

TEST_CASE("tables measure a run by one protocol after another, however many commands run side by side") {
  const fs::path out = scratch() / "turned-tables", log = scratch() / "turned-logs";
  const Outcome made = cloam_with({"synth", "-o", log.string(), "--logs", "1", "--frames", "3", "--size", "48x27",
                                   "--cameras", "front,front_left", "--beams", "12", "--night", "0", "-q"});
  REQUIRE_MESSAGE(made.code == 0, made.err);
  Words words =
      tables(out, {"--rows", "full", "--measure", (log / "001").string(), "--steps", "train=10,fit=10", "--jobs", "2"});
  std::replace(words.begin(), words.end(), std::string("sparse"), std::string("novel,rotate360"));
  const Outcome outcome = cloam_with(words);
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  for (const char* protocol : {"novel", "rotate360"})
    CHECK(json_of(out / "measure/full/1/001" / protocol / "eval.json").at("protocol") == protocol);
}

TEST_CASE("tables hold what the evaluations found, and a page that needs nothing else") {
  const auto json = json_of(undisturbed() / "tables.json");
  const auto eval = json_of(undisturbed() / "measure/full/1/002/sparse/eval.json");
  const auto cells = json.at("tables").at(0).at("rows").at(0).at("cells");
  int found = 0;
  for (const auto& cell : cells) {
    const std::string key = cell.at("key");
    CHECK_MESSAGE(cell.at("mean") == eval.at(key), key);
    if (key != "masked_psnr") continue;
    ++found;
    CHECK(cell.at("paper") == 21.34);
    CHECK(cell.at("guess") == eval.at(cell.at("guess_key").get<std::string>()));
  }
  CHECK(found == 1);
  for (const char* file : {"tables.json", "tables.md"})
    CHECK_FALSE(contains(content_of(undisturbed() / file), scratch().string()));
  const std::string page = content_of(undisturbed() / "index.html");
  CHECK(contains(page, "full model: error, four times as bright"));
  CHECK(contains(page, "data:image/jpeg;base64,"));
  CHECK(contains(page, "cloam train genassets"));
  CHECK_FALSE(contains(page, "src=\"/"));
}

TEST_CASE("tables go on with what is new, and refuse what differs; a command that fails is told") {
  const fs::path out = copy_of(undisturbed(), "more-tables"), broken = copy_of(logs() / "002", "broken");
  write_text(broken / "camera/front_camera/03.jpg", "no picture");
  const auto before = snapshot(out);
  const Outcome other =
      cloam_with(tables(out, {"--rows", "full", "--measure", (logs() / "002").string(), "--steps", "train=60,fit=61"}));
  CHECK(other.code == 2);
  CHECK_MESSAGE(contains(other.err, "fit/full/1/002/sparse differs"), other.err);
  CHECK(contains(other.err, "--steps 61"));
  CHECK(snapshot(out) == before);

  const Outcome more = cloam_with(tables(out, {"--rows", "full", "--json", "--steps", "train=60,fit=60", "--measure",
                                               broken.string() + "," + (logs() / "002").string()}));
  CHECK_MESSAGE(more.code == 3, more.err);
  CHECK_MESSAGE(contains(more.err, "1 of 5 commands failed, and 1 that need them were left out"), more.err);
  const auto told = nlohmann::json::parse(more.out);
  CHECK(told.at("done") == 3);
  CHECK(told.at("failed").at(0).at("id") == "fit/full/1/broken/sparse");
  CHECK(contains(told.at("failed").at(0).at("error"), "03.jpg"));
  CHECK(told.at("left_out").at(0).at("id") == "measure/full/1/broken/sparse");
  CHECK(contains(content_of(out / "index.html"), "03.jpg"));
  CHECK(contains(content_of(out / "tables.md"), "(1 of 2 measured)"));
  for (const auto& [file, bytes] : before)
    if (file.starts_with("train/") || file.starts_with("nodes/")) CHECK_MESSAGE(snapshot(out)[file] == bytes, file);
}

TEST_CASE("tables tell their commands and hours, and write nothing, with --dry-run") {
  const fs::path out = scratch() / "no-tables";
  const Outcome outcome = cloam_with({"tables", "--size", "small", "-o", out.string(), "--dry-run", "--json"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  const auto json = nlohmann::json::parse(outcome.out);
  double hours = 0;
  for (const auto& command : json.at("commands")) hours += command.at("hours").get<double>();
  CHECK(hours == doctest::Approx(json.at("hours").get<double>()));
  CHECK(hours < 3);
  CHECK_FALSE(fs::exists(out));
  const Words measuring = {"tables",     "--size",    "small",     "-o",
                           out.string(), "--dry-run", "--measure", (logs() / "002").string()};
  const Outcome made_to_train = cloam_with(measuring);
  CHECK_MESSAGE(contains(made_to_train.out, "logs/clouds"), made_to_train.err);
  CHECK(contains(made_to_train.out, "fit/full/1/002/sparse"));
  CHECK_FALSE(contains(made_to_train.out, "logs/measured"));
  fs::create_directories(scratch() / "own-tables/logs/sun");
  const fs::path own = copy_of(logs() / "002", "own-tables/logs/sun/001");
  const Outcome trained_on = cloam_with(
      {"tables", "--size", "small", "-o", (scratch() / "own-tables").string(), "--dry-run", "--measure", own.string()});
  CHECK(trained_on.code == 2);
  CHECK_MESSAGE(contains(trained_on.err, "measure another log"), trained_on.err);
  const Words unknown = {"tables", "--size", "small", "-o", out.string(), "--rows", "ful"};
  CHECK(contains(cloam_with(unknown).err, "did you mean full?"));
  CHECK(cloam_with({"tables", "-o", out.string()}).code == 2);  // the paper's sizes need logs
}
