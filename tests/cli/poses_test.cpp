// Poses that are learned, through the real program: the capture that is written, and what is told when there is none.
#include <doctest/doctest.h>

#include <nlohmann/json.hpp>

#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

TEST_CASE("poses that a run learned are a capture that another run learns from") {
  const fs::path run = scratch() / "poses", capture = scratch() / "poses-capture";
  const Outcome outcome =
      cloam_with({"train", "nerf", small_scene().string(), "-o", run.string(), "--steps", "30", "--set",
                  "poses.refine=true", "--set", "poses.warm_up=0", "--set", "batch.samples=2048"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(contains(content_of(run / "metrics.jsonl"), "\"turned\":"));
  const Outcome written = cloam_with({"export", run.string(), "--format", "capture", "-o", capture.string(), "--json"});
  REQUIRE_MESSAGE(written.code == 0, written.err);
  const auto told = nlohmann::json::parse(written.out);
  CHECK(told.at("photos") == 10);
  CHECK(told.at("refined") == 8);
  CHECK(told.at("turned_degrees").get<double>() > 0.01);
  CHECK(told.at("turned_degrees").get<double>() < 5);
  const Outcome again = cloam_with(
      {"train", "nerf", capture.string(), "-o", (scratch() / "poses-again").string(), "--steps", "2", "--json"});
  CHECK_MESSAGE(again.code == 0, again.err);
}

TEST_CASE("a run that left poses as they are has no capture to write") {
  const fs::path out = scratch() / "no-capture";
  const Outcome outcome = cloam_with({"export", small_run().string(), "--format", "capture", "-o", out.string()});
  CHECK(outcome.code == 2);
  CHECK_MESSAGE(contains(outcome.err, "learned neither poses nor boxes"), outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "poses.refine=true"), outcome.err);
  CHECK(!fs::exists(out));
}
