// What surrounds the program must not change what it computes: other processes, the order of devices, the environment.
#include <doctest/doctest.h>
#include <signal.h>

#include <chrono>
#include <memory>
#include <thread>

#include "tests/cli/small_trainings.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

Words shared_cache(const std::string& name) {
  fs::create_directories(scratch() / name);
  return {"POCL_CACHE_DIR=" + (scratch() / name).string(), "CLOAM_CACHE_DIR=" + (scratch() / name).string()};
}

const Words kFewKernels = {"selftest", "--quick", "--only", "cumsum"};

/// The parameters of a few steps of splat, to the bit; the error where there are none.
std::string bytes_with(const Words& environment, const Words& more = {}) {
  static int number = 0;
  const fs::path run = scratch() / ("surroundings" + std::to_string(number++));
  Words words = {"--steps", "3", "--seed", "1"};
  words.insert(words.end(), more.begin(), more.end());
  const Outcome outcome = cloam_with(small_trainings()[1].words(run, words), environment);
  return outcome.code == 0 ? content_of(run / "ckpt" / "000003.safetensors") : outcome.err;
}

}  // namespace

TEST_CASE("eight processes share an empty folder of compiled kernels") {
  const Words cache = shared_cache("eight");
  std::vector<std::unique_ptr<Process>> all;
  for (int i = 0; i < 8; i++) all.push_back(std::make_unique<Process>(kFewKernels, cache));
  for (auto& process : all) {
    const Outcome outcome = process->wait();
    CHECK_MESSAGE(outcome.code == 0, outcome.out, outcome.err);
  }
}

TEST_CASE("a process that is killed while it compiles leaves a folder of kernels that others can use") {
  for (const int milliseconds : {150, 400, 900}) {
    const Words cache = shared_cache("killed" + std::to_string(milliseconds));
    Process process(kFewKernels, cache);
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
    process.signal(SIGKILL);
    process.wait();
    const Outcome outcome = cloam_with(kFewKernels, cache);
    CHECK_MESSAGE(outcome.code == 0, outcome.out, outcome.err);
  }
}

TEST_CASE("a device gives the same bytes wherever it stands in the list, and whatever the surroundings") {
  const std::string want = bytes_with({});
  REQUIRE(want.size() > 1000);
  for (const char* devices : {"POCL_DEVICES=basic pthread", "POCL_DEVICES=pthread basic"})
    for (const char* id : {"0:0", "0:1"}) CHECK(bytes_with({devices}, {"--device", id}) == want);
  for (const char* variable : {"LC_ALL=de_DE.UTF-8", "LC_ALL=tr_TR.UTF-8", "OPENCL_LAYERS=/nonexistent.so",
                               "POCL_EXTRA_BUILD_FLAGS=-g", "OCL_ICD_DEBUG=7", "TZ=Mars", "TERM="}) {
    CAPTURE(variable);
    CHECK(bytes_with({variable}) == want);
  }
}

TEST_CASE("surroundings that change results, or leave no device, are named") {
  const fs::path run = scratch() / "fast-maths";
  const Outcome fast =
      cloam_with(small_trainings()[1].words(run, {"--steps", "1"}), {"POCL_EXTRA_BUILD_FLAGS=-cl-fast-relaxed-math"});
  CHECK(fast.code == 0);
  CHECK_MESSAGE(contains(fast.err, "warning: POCL_EXTRA_BUILD_FLAGS=-cl-fast-relaxed-math changes how kernels are "),
                fast.err);
  const std::string unknown = bytes_with({"POCL_EXTRA_BUILD_FLAGS=--bogus"});
  CHECK_MESSAGE(contains(unknown, "  fix: unset POCL_EXTRA_BUILD_FLAGS, "), unknown);
  const std::string nonsense = bytes_with({"POCL_DEVICES=nonsense", "OCL_ICD_VENDORS=pocl.icd"});
  CHECK_MESSAGE(contains(nonsense, "(POCL_DEVICES=nonsense)"), nonsense);
}
