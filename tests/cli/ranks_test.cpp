// Batches in shares and several ranks, through the program.
#include <doctest/doctest.h>

#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

std::string checkpoint_of(const fs::path& run, const std::string& step) {
  return content_of(run / "ckpt" / (step + ".safetensors"));
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
  const Outcome resumed = cloam_with({"train", "--resume", halves.string()});
  CHECK_MESSAGE(resumed.code == 0, resumed.err);
  CHECK_FALSE(contains(resumed.err, "warning"));
  CHECK(checkpoint_of(halves, "000006") == checkpoint_of(whole, "000006"));
  const Outcome others =
      cloam_with({"train", "--resume", halves.string(), "--steps", "7", "--gradient-accumulation", "3"});
  CHECK(others.code == 0);
  CHECK_MESSAGE(contains(others.err, "warning: from here on a step's batch is parted in 3 instead of 2 shares"),
                others.err);
  CHECK(json_of(halves / "run.json").at("options").at("shares") == 3);
}

TEST_CASE("a batch is not parted so far that a share has nothing") {
  const Outcome outcome = cloam_with(small_diffusion(two_streets_run(), scratch() / "too_many_shares",
                                                     {"--set", "batch.codes=4", "--gradient-accumulation", "5"}));
  CHECK(outcome.code == 2);
  CHECK_MESSAGE(contains(outcome.err, "a step's batch cannot be parted in 5 shares"), outcome.err);
  CHECK_FALSE(fs::exists(scratch() / "too_many_shares"));
}
