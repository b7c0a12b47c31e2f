// Batches in shares and several ranks, through the program.
#include <doctest/doctest.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <memory>
#include <thread>

#include "models/io/safetensors.h"
#include "tests/cli/mpirun.h"
#include "tests/cli/small_street.h"
#include "tests/cli/small_trainings.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

std::string checkpoint_of(const fs::path& run, const std::string& step) {
  return content_of(run / "ckpt" / (step + ".safetensors"));
}

int times_in(const std::string& text, const std::string& words) {
  int count = 0;
  for (size_t at = text.find(words); at != std::string::npos; at = text.find(words, at + 1)) ++count;
  return count;
}

}  // namespace

TEST_CASE("a run records its shares and keeps them when it is resumed") {
  const fs::path whole = scratch() / "in_shares", halves = scratch() / "in_shares_resumed";
  const Words shares = {"--steps", "6", "--save-every", "3", "--gradient-accumulation", "2"};
  REQUIRE(cloam_with(small_training(small_scene(), whole, shares)).code == 0);
  CHECK(json_of(whole / "run.json").at("options").at("shares") == 2);
  Words first = shares;
  first.insert(first.end(), {"--stop-after", "3"});
  REQUIRE(cloam_with(small_training(small_scene(), halves, first)).code == 0);
  const Outcome resumed = cloam_with({"train", "--resume", halves.string(), "--pictures", "off"});
  CHECK_MESSAGE(resumed.code == 0, resumed.err);
  CHECK_FALSE(contains(resumed.err, "warning"));
  CHECK(checkpoint_of(halves, "000006") == checkpoint_of(whole, "000006"));
  const Outcome others = cloam_with(
      {"train", "--resume", halves.string(), "--pictures", "off", "--steps", "7", "--gradient-accumulation", "3"});
  CHECK(others.code == 0);
  CHECK_MESSAGE(contains(others.err, "warning: from here on a step's batch is split into 3 instead of 2 shares"),
                others.err);
  CHECK(json_of(halves / "run.json").at("options").at("shares") == 3);
}

TEST_CASE("a plan for more devices than there are: what a step sends, and the time that links add") {
  const auto planned = [](const Words& how) {
    Words words = small_training(small_scene(), scratch() / "planned_for_ranks", {"--steps", "50", "--dry-run"});
    std::replace(words.begin(), words.end(), std::string("plain"), std::string("jsonl"));
    words.insert(words.end(), how.begin(), how.end());
    return cloam_with(words);
  };
  const Outcome outcome = planned({"--ranks", "2", "--link", "8Mb"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  const auto scale = nlohmann::json::parse(outcome.out.substr(outcome.out.rfind("{\"")));
  CHECK(scale.at("event") == "scale");
  CHECK(scale.at("steps") == 50);
  CHECK(scale.at("link_bytes_per_second") == 1e6);
  // Of two ranks each sends half of its gradients to be summed, and half of the sums: as many floats as parameters.
  const fs::path trained = scratch() / "planned_and_made";
  REQUIRE(cloam_with(small_training(small_scene(), trained, {"--steps", "1", "-q"})).code == 0);
  double parameters = 0;  // bytes
  for (const auto& [name, tensor] : read_safetensors(trained / "ckpt" / "000001.safetensors").tensors)
    if (name.starts_with("param.")) parameters += static_cast<double>(tensor.data.size());
  CHECK(scale.at("sent_bytes").get<double>() == doctest::Approx(parameters).epsilon(0.02));
  CHECK(scale.at("waiting_seconds") >= 0);
  const double step = scale.at("rank_step_seconds").get<double>() + scale.at("waiting_seconds").get<double>() +
                      scale.at("sent_bytes").get<double>() / 1e6;
  CHECK(scale.at("step_seconds").get<double>() == doctest::Approx(step));
  CHECK(scale.at("seconds").get<double>() == doctest::Approx(50 * step));
  CHECK_FALSE(fs::exists(scratch() / "planned_for_ranks"));
  CHECK(contains(planned({"--ranks", "2", "--link", "fast"}).err, "--link fast: want a speed such as 100Gb"));
  const Outcome resumed = cloam_with(
      {"train", "--resume", trained.string(), "--steps", "31", "--dry-run", "--ranks", "2", "--progress", "jsonl"});
  REQUIRE_MESSAGE(resumed.code == 0, resumed.err);
  CHECK(nlohmann::json::parse(resumed.out.substr(resumed.out.rfind("{\""))).at("steps") == 30);
  const Outcome trained_by_mistake =
      cloam_with(small_training(small_scene(), scratch() / "planned_for_ranks", {"--ranks", "2"}));
  CHECK(trained_by_mistake.code == 2);
  CHECK_MESSAGE(contains(trained_by_mistake.err, "fix: add --dry-run"), trained_by_mistake.err);
}

TEST_CASE("a batch is not split so far that a share has nothing") {
  const Outcome outcome = cloam_with(small_diffusion(two_streets_run(), scratch() / "too_many_shares",
                                                     {"--set", "batch.codes=4", "--gradient-accumulation", "5"}));
  CHECK(outcome.code == 2);
  CHECK_MESSAGE(contains(outcome.err, "a step's batch cannot be split into 5 shares"), outcome.err);
  CHECK_FALSE(fs::exists(scratch() / "too_many_shares"));
}

TEST_CASE("two ranks are two shares on one, byte for byte, in every method") {
  for (const SmallTraining& small : small_trainings()) {
    CAPTURE(small.method);
    const fs::path one = scratch() / (std::string(small.method) + "_shares"),
                   two = scratch() / (std::string(small.method) + "_ranks");
    Words how = {"--steps", "6", "--save-every", "3"};
    if (small.method == std::string("genassets") || small.method == std::string("neurad"))
      how.insert(how.end(), {"--set", "batch.patches=2"});
    Words alone = how;
    alone.insert(alone.end(), {"--gradient-accumulation", "2"});
    const Outcome shares = cloam_with(small.words(one, alone));
    REQUIRE_MESSAGE(shares.code == 0, shares.err);
    const Outcome ranks = Ranks(2, small.words(two, how)).wait();
    REQUIRE_MESSAGE(ranks.code == 0, ranks.err);
    CHECK(checkpoint_of(two, "000003") == checkpoint_of(one, "000003"));
    CHECK(checkpoint_of(two, "000006") == checkpoint_of(one, "000006"));
    if (small.method == std::string("splat")) {
      const fs::path apart = scratch() / "splat_apart";
      REQUIRE(Ranks(2, small.words(apart, how), {"CLOAM_RANK_MEMORY=apart"}).wait().code == 0);
      CHECK(checkpoint_of(apart, "000006") == checkpoint_of(one, "000006"));
    }
    CHECK(json_of(two / "run.json").at("options").at("shares") == 2);
    CHECK(json_of(two / "run.json").at("state") == "finished");
  }
}

TEST_CASE("a run of two ranks goes on as one process, and as four ranks with other shares") {
  const fs::path run = scratch() / "two_then_one", left_alone = scratch() / "nerf_ranks";
  const Words how = {"--steps", "6", "--save-every", "3"};
  if (!fs::exists(left_alone)) REQUIRE(Ranks(2, small_training(small_scene(), left_alone, how)).wait().code == 0);
  Words first = how;
  first.insert(first.end(), {"--stop-after", "3"});
  REQUIRE(Ranks(2, small_training(small_scene(), run, first)).wait().code == 0);
  const fs::path four = copy_of(run, "two_then_four");
  REQUIRE(cloam_with({"train", "--resume", run.string(), "--pictures", "off"}).code == 0);
  CHECK(checkpoint_of(run, "000006") == checkpoint_of(left_alone, "000006"));
  const Outcome more = Ranks(4, {"train", "--resume", four.string(), "--pictures", "off"}).wait();
  CHECK_MESSAGE(more.code == 0, more.err);
  CHECK_MESSAGE(contains(more.err, "is split into 4 instead of 2 shares"), more.err);
  CHECK(json_of(four / "run.json").at("state") == "finished");
}

TEST_CASE("one rank speaks and writes: the words of a run are said once") {
  const fs::path run = scratch() / "said_once";
  const Outcome outcome = Ranks(2, small_training(small_scene(), run, {"--steps", "2"})).wait();
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(times_in(outcome.err, "model  nerf") == 1);
  CHECK(times_in(content_of(run / "metrics.jsonl"), "\"event\":\"end\"") == 1);
}

TEST_CASE("what all ranks find wrong is told once, and ends all") {
  const Outcome outcome = Ranks(2, {"train", "nerf", (scratch() / "no_such_data").string()}).wait();
  CHECK(outcome.code == 3);
  CHECK_MESSAGE(contains(outcome.err, "error: rank 0 of 2: "), outcome.err);
  CHECK_MESSAGE(!contains(outcome.err, "error: rank 1 of 2: "), outcome.err);
}

TEST_CASE("commands that cannot share their work refuse several ranks") {
  for (const std::string command : {"report", "info"}) {
    Words words = {command};
    if (command != "info") words.push_back(small_run().string());
    const Outcome outcome = Ranks(2, words).wait();
    CHECK(outcome.code == 2);
    CHECK_MESSAGE(contains(outcome.err, "cloam " + command + " cannot share its work among 2 ranks"), outcome.err);
    CHECK_MESSAGE(contains(outcome.err, "those that can are train, render, eval, generate, simulate, tables"),
                  outcome.err);
  }
}

TEST_CASE("started as one of several without the library: one clear error") {
  const fs::path bin = scratch() / "without_mpi" / "bin";
  fs::create_directories(bin);
  fs::copy_file(CLOAM_BINARY, bin / "cloam");
  const fs::path said = scratch() / "without_mpi" / "said";
  const std::string line = "OMPI_COMM_WORLD_SIZE=2 " + (bin / "cloam").string() + " info 2>" + said.string();
  CHECK(WEXITSTATUS(std::system(line.c_str())) == 2);
  CHECK_MESSAGE(contains(content_of(said), "started as one of several ranks, but without MPI"), content_of(said));
}

TEST_CASE("ranks split the cores that they share, and take the devices that are named") {
  const fs::path run = scratch() / "named_devices";
  const Outcome unknown =
      Ranks(2, small_training(small_scene(), run, {"--steps", "2", "--devices", "0:0,no-such-device"})).wait();
  CHECK(unknown.code != 0);
  CHECK_MESSAGE(contains(unknown.err, "rank 1 of 2: "), unknown.err);
  CHECK_MESSAGE(contains(unknown.err, "no-such-device"), unknown.err);
  const Outcome alone = cloam_with(small_training(small_scene(), run, {"--devices", "0:0"}));
  CHECK(alone.code == 2);
  CHECK_MESSAGE(contains(alone.err, "--devices is for the ranks of mpirun"), alone.err);
}

namespace {

/// Steps enough that a rank can be lost among them.
const Words kLongRun = {"--steps", "150", "--save-every", "10"};

const std::string& bytes_left_alone() {
  static const std::string bytes = [] {
    const fs::path run = scratch() / "long_shares";
    Words how = kLongRun;
    how.insert(how.end(), {"--gradient-accumulation", "2", "-q"});
    REQUIRE(cloam_with(small_training(small_scene(), run, how)).code == 0);
    return checkpoint_of(run, "000150");
  }();
  return bytes;
}

/// Two ranks that have saved a checkpoint of a run that is not over.
std::unique_ptr<Ranks> ranks_under_way(const fs::path& run, const Words& environment = {}) {
  auto ranks = std::make_unique<Ranks>(2, small_training(small_scene(), run, kLongRun), environment);
  for (int i = 0; i < 600 && ranks->running() && !fs::exists(run / "ckpt" / "latest.txt"); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  REQUIRE_MESSAGE(ranks->running(), ranks->wait().err);
  return ranks;
}

/// What has ended may wait, as a zombie, for somebody to ask after it.
bool lives(pid_t process) {
  const std::string stat = content_of("/proc/" + std::to_string(process) + "/stat");
  const size_t state = stat.rfind(") ");
  return state != std::string::npos && stat[state + 2] != 'Z';
}

/// Its outcome, which a minute is enough for, and that nothing of it is left.
Outcome ended(Ranks& ranks, const std::vector<pid_t>& processes) {
  const auto is_left = [&] { return ranks.running() || std::any_of(processes.begin(), processes.end(), lives); };
  for (int i = 0; i < 600 && is_left(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(100));
  REQUIRE_MESSAGE(!is_left(), "still there after a minute: " << ranks.said());
  return ranks.wait();
}

}  // namespace

TEST_CASE("a rank that is killed ends all; the run goes on from its checkpoint to the same bytes") {
  for (const int lost : {0, 1}) {
    CAPTURE(lost);
    const fs::path run = scratch() / ("lost_rank_" + std::to_string(lost));
    const auto ranks = ranks_under_way(run);
    const std::vector<pid_t> processes = ranks->processes();
    CHECK(processes.size() == 2);
    if (contains(json_of(run / "run.json").at("device"), "Portable Computing Language"))
      for (const pid_t one : processes)
        CHECK(contains(content_of("/proc/" + std::to_string(one) + "/maps"), "memfd:cloam ranks"));
    const pid_t process = ranks->process_of(lost);
    REQUIRE(process > 0);
    REQUIRE(kill(process, SIGKILL) == 0);
    const Outcome outcome = ended(*ranks, processes);
    CHECK(outcome.code != 0);
    CHECK_MESSAGE(contains(outcome.err, "rank " + std::to_string(lost) + " "), outcome.err);
    const Words resume = {"train", "--resume", run.string(), "--pictures", "off", "-q"};
    const Outcome resumed = lost == 0 ? cloam_with(resume) : Ranks(2, resume).wait();
    CHECK_MESSAGE(resumed.code == 0, resumed.err);
    CHECK(checkpoint_of(run, "000150") == bytes_left_alone());
  }
}

TEST_CASE("a rank that stands still is noticed and named") {
  const fs::path run = scratch() / "stopped_rank";
  const auto ranks = ranks_under_way(run, {"CLOAM_RANK_TIMEOUT=5s"});
  const std::vector<pid_t> processes = ranks->processes();
  const pid_t stopped = ranks->process_of(1);
  REQUIRE(stopped > 0);
  REQUIRE(kill(stopped, SIGSTOP) == 0);
  const Outcome outcome = ended(*ranks, processes);
  CHECK(outcome.code == 4);
  CHECK_MESSAGE(contains(outcome.err, "rank 1 has not answered for 5s"), outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "is whole; cloam train --resume"), outcome.err);
  CHECK(json_of(run / "run.json").at("state") == "failed");
}

TEST_CASE("ranks that are asked to stop save first, and go on later") {
  const fs::path run = scratch() / "asked_ranks";
  const auto ranks = ranks_under_way(run);
  const std::vector<pid_t> processes = ranks->processes();
  REQUIRE(kill(ranks->launcher(), SIGUSR2) == 0);  // mpirun passes it on
  const Outcome outcome = ended(*ranks, processes);
  CHECK(outcome.code == 128 + SIGUSR2);
  CHECK_MESSAGE(contains(outcome.err, "stopping: finishing this step, then saving"), outcome.err);
  CHECK(json_of(run / "run.json").at("state") == "interrupted");
  CHECK(cloam_with({"train", "--resume", run.string(), "--pictures", "off", "-q"}).code == 0);
  CHECK(checkpoint_of(run, "000150") == bytes_left_alone());
}
