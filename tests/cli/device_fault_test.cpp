// A driver that fails in the middle of a training: each call of each kind fails once (tests/layer), the device is lost
// at some. The training survives or ends in one error, and the run goes on to the bytes of one without a fault. The
// suite takes one call of each kind, two kinds of each method; CLOAM_FAULTS=all (script/device-faults) takes every one
// that is not made again, CLOAM_FAULTS_PART=2/8 the third eighth of them, so that programs can share the work.
#include <doctest/doctest.h>
#include <signal.h>

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>
#include <thread>

#include "tests/cli/process.h"
#include "tests/cli/small_trainings.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// Two checkpoints: at the middle and at the end.
Words words_of(const SmallTraining& training, const fs::path& run) {
  const std::string method = training.method;
  const bool street = method == "genassets" || method == "street-gaussians" || method == "neurad";
  Words words = {"--steps", street ? "2" : "4", "--save-every", street ? "1" : "2"};
  if (method == "nerf")
    words.insert(words.end(), {"--pictures", "on"});  // elsewhere their calls would outnumber the steps'
  return training.words(run, words);
}

/// Calls that make something or put work into the queue, and those that wait.
const char* const kCalls[] = {"clCreateContext",
                              "clCreateCommandQueue",
                              "clCreateProgramWithSource",
                              "clBuildProgram",
                              "clCreateKernel",
                              "clCreateBuffer",
                              "clCreateSubBuffer",
                              "clSetKernelArg",
                              "clEnqueueMapBuffer",
                              "clEnqueueUnmapMemObject",
                              "clEnqueueWriteBuffer",
                              "clEnqueueNDRangeKernel",
                              "clEnqueueReadBuffer",
                              "clFinish"};

/// Of those the ones that are made again when they fail.
const char* const kMadeAgain[] = {"clCreateProgramWithSource:1/2",
                                  "clBuildProgram:1/2",
                                  "clCreateKernel:1/2",
                                  "clCreateBuffer:1/2",
                                  "clCreateSubBuffer:1/2",
                                  "clSetKernelArg:1/2",
                                  "clEnqueueMapBuffer:1/2",
                                  "clEnqueueUnmapMemObject:1/2",
                                  "clEnqueueWriteBuffer:1/2",
                                  "clEnqueueNDRangeKernel:1/2"};

Words layer(const std::string& settings) { return {"OPENCL_LAYERS=" CLOAM_LAYER_LIBRARY, "CLOAM_LAYER=" + settings}; }

/// Whether the next piece of work is this program's part.
bool mine() {
  static int number = 0;
  const char* part = std::getenv("CLOAM_FAULTS_PART");
  const int count = part && std::strchr(part, '/') ? std::atoi(std::strchr(part, '/') + 1) : 1;
  return number++ % std::max(1, count) == (part ? std::atoi(part) : 0);
}

/// Ended by force after a minute: a hang.
Outcome outcome_of(const Words& words, const Words& environment) {
  Process process(words, environment);
  const auto began = std::chrono::steady_clock::now();
  while (process.running()) {
    if (std::chrono::steady_clock::now() - began > std::chrono::minutes(1)) process.signal(SIGKILL);
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return process.wait();
}

std::string last_checkpoint(const fs::path& run) {
  std::string name = content_of(run / "ckpt" / "latest.txt");
  while (!name.empty() && name.back() == '\n') name.pop_back();
  return content_of(run / "ckpt" / name);
}

struct Tally {
  int failed = 0, survived = 0, resumed = 0, refused = 0;
};

/// One error of the documented form: "error: ...  [exit N]", and further lines that are indented.
void check_told(const Outcome& outcome) {
  const std::size_t at = outcome.err.find("error: ");
  REQUIRE_MESSAGE(at != std::string::npos, outcome.err);
  CHECK_MESSAGE(at == outcome.err.rfind("error: "), outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "  [exit " + std::to_string(outcome.code) + "]"), outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "\n  fix: "), outcome.err);
  CHECK_MESSAGE(!contains(outcome.err, "internal error"), outcome.err);
  std::istringstream lines(outcome.err.substr(at));
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line)) CHECK_MESSAGE(line.starts_with("  "), outcome.err);
}

int samples() {
  const char* given = std::getenv("CLOAM_FAULTS");
  if (!given) return 1;
  return std::string(given) == "all" ? 1 << 30 : std::atoi(given);
}

/// In the suite methods take turns, for they share the code that calls the driver: one of so many
/// tries a kind of call.
bool has_turn(std::size_t method, std::size_t call, std::size_t turns) {
  return samples() > 1 || method % turns == call % turns;
}

class Sweep {
 public:
  explicit Sweep(const SmallTraining& training) : training_(training), golden_(fresh()) {
    const fs::path counts = scratch() / (std::string(training.method) + "-calls");
    const Outcome outcome = cloam_with(words_of(training, golden_), layer("count=" + counts.string()));
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    std::ifstream file(counts);
    std::string function;
    for (int calls = 0; file >> function >> calls;) calls_[function] = calls;
  }

  /// So many calls of the function, spread evenly; all if there are no more.
  void let_fail(const std::string& function, int samples, const std::string& how, Tally& tally) {
    const int calls = calls_of(function), taken = std::min(calls, samples);
    for (int i = 0; i < taken; i++) {
      if (!mine()) continue;
      const auto call = static_cast<int>((2 * int64_t{i} + 1) * calls / (2 * int64_t{taken})) + 1;
      try_one(text_of("fail=" + function, call) + how, tally);
    }
  }

  /// All calls that are made again fail at first, in one training: so many of them. It gives the bytes of golden.
  int let_each_fail_at_first() {
    std::string faults;
    int calls = 0;
    for (const std::string call : kMadeAgain) {
      faults += "fail=" + call + ",";
      calls += calls_of(call.substr(0, call.find(':')));
    }
    const fs::path run = fresh();
    const Outcome outcome = outcome_of(words_of(training_, run), layer(faults));
    CHECK_MESSAGE(outcome.code == 0, outcome.err);
    CHECK(last_checkpoint(run) == last_checkpoint(golden_));
    return calls;
  }

  /// Alone, calls that are made again need no more than some examples.
  int samples_of(const std::string& function) const {
    for (const std::string call : kMadeAgain)
      if (call.starts_with(function + ":")) return std::min(samples(), 3);
    return samples();
  }

  int calls_of(const std::string& function) const { return calls_.contains(function) ? calls_.at(function) : 0; }

 private:
  static std::string text_of(const std::string& call, int number) { return call + ":" + std::to_string(number); }
  /// A folder that no other sweep has.
  fs::path fresh() {
    static int made = 0;
    return scratch() / (std::string(training_.method) + "-faults" + std::to_string(made++));
  }

  void try_one(const std::string& fault, Tally& tally) {
    CAPTURE(training_.method);
    CAPTURE(fault);
    const fs::path run = fresh();
    const Outcome outcome = outcome_of(words_of(training_, run), layer(fault));
    tally.failed++;
    if (outcome.code == 0) {
      tally.survived++;
      CHECK_MESSAGE(last_checkpoint(run) == last_checkpoint(golden_), outcome.err);
    } else {
      CHECK_MESSAGE((outcome.code == 4 || outcome.code == 5), outcome.code, " ", outcome.err);
      check_told(outcome);
      resume(run, outcome, tally);
    }
    fs::remove_all(run);
  }

  /// A run that was begun goes on to the same bytes; before, nothing is written.
  void resume(const fs::path& run, const Outcome& outcome, Tally& tally) {
    if (!fs::exists(run / "run.json")) {
      tally.refused++;
      CHECK_FALSE(fs::exists(run / "ckpt"));
      return;
    }
    tally.resumed++;
    const std::string state = json_of(run / "run.json").at("state");
    CHECK_MESSAGE((state == "failed" || state == "finished"), state);
    if (state == "failed") CHECK_MESSAGE(contains(outcome.err, "cloam train --resume " + run.string()), outcome.err);
    const Outcome again =
        outcome_of({"train", "--resume", run.string(), "--progress", "plain", "--pictures", "off"}, {});
    CHECK_MESSAGE(again.code == 0, again.err);
    CHECK_MESSAGE(last_checkpoint(run) == last_checkpoint(golden_), outcome.err, again.err);
  }

  const SmallTraining& training_;
  fs::path golden_;
  std::map<std::string, int> calls_;
};

/// One for all cases: each begins with a training that nothing fails in.
Sweep& sweep_of(const SmallTraining& training) {
  static std::map<std::string, Sweep> sweeps;
  return sweeps.try_emplace(training.method, training).first->second;
}

void tell(const std::string& method, const std::string& what, const Tally& tally) {
  MESSAGE(method, ", ", what, ": ", tally.failed, " calls failed, ", tally.survived, " survived, ", tally.resumed,
          " ended in an error and were resumed to the same bytes, ", tally.refused,
          " ended before anything was written");
}

}  // namespace

TEST_CASE("device faults: every call that can be made again fails at first, and no bit changes") {
  for (const SmallTraining& training : small_trainings()) {
    const int calls = sweep_of(training).let_each_fail_at_first();
    MESSAGE(std::string(training.method), ": ", calls, " calls failed at first");
    CHECK(calls > 1000);
  }
}

TEST_CASE("device faults: each call of a training fails once") {
  int failed = 0, survived = 0;
  for (std::size_t method = 0; method < small_trainings().size(); method++) {
    const SmallTraining& training = small_trainings()[method];
    Sweep& sweep = sweep_of(training);
    Tally tally;
    int calls = 0;
    for (std::size_t i = 0; i < std::size(kCalls); i++) {
      if (has_turn(method, i, small_trainings().size()))
        sweep.let_fail(kCalls[i], sweep.samples_of(kCalls[i]), "", tally);
      calls += sweep.calls_of(kCalls[i]);
    }
    MESSAGE(std::string(training.method), " makes ", calls, " calls");
    tell(training.method, "each once", tally);
    failed += tally.failed, survived += tally.survived;
  }
  if (samples() < 4 && failed > 10) CHECK(survived > failed / 3);
}

TEST_CASE("device faults: a training whose device is lost ends in one error and is resumed to the same bytes") {
  const char* const lost_at[] = {"clCreateBuffer", "clEnqueueNDRangeKernel", "clEnqueueReadBuffer"};
  int failed = 0;
  for (std::size_t method = 0; method < small_trainings().size(); method++) {
    const SmallTraining& training = small_trainings()[method];
    Sweep& sweep = sweep_of(training);
    Tally tally;
    for (std::size_t i = 0; i < std::size(lost_at); i++)
      if (has_turn(method, i, std::size(lost_at))) sweep.let_fail(lost_at[i], samples() > 1 ? 40 : 1, ",sticky", tally);
    tell(training.method, "device lost", tally);
    failed += tally.failed;
    CHECK(tally.survived == 0);
    if (tally.failed > 2) CHECK(tally.resumed > 0);
  }
  if (!std::getenv("CLOAM_FAULTS_PART")) CHECK(failed >= static_cast<int>(small_trainings().size()));
}

TEST_CASE("device faults: a device that hangs ends the training, whose checkpoint is kept") {
  const SmallTraining& training = small_trainings().front();
  const fs::path run = scratch() / "hung", golden = scratch() / "not-hung";
  REQUIRE(cloam_with(words_of(training, golden)).code == 0);
  Words environment = layer("hang=clEnqueueReadBuffer:20");
  environment.push_back("CLOAM_WATCHDOG=1");
  const Outcome outcome = outcome_of(words_of(training, run), environment);
  CHECK_MESSAGE(outcome.code == 4, outcome.code, outcome.err);
  check_told(outcome);
  CHECK_MESSAGE(contains(outcome.err, "the device has not answered for 1 s: "), outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "launched last, the newest first: "), outcome.err);
  CHECK(json_of(run / "run.json").at("state") == "failed");
  CHECK(cloam_with({"train", "--resume", run.string(), "--pictures", "off"}).code == 0);
  CHECK(last_checkpoint(run) == last_checkpoint(golden));
}
