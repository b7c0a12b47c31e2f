// Poses that are learned, through the real program: the capture that is written, and what is told when there is none.
#include <doctest/doctest.h>

#include <nlohmann/json.hpp>

#include "models/data/read_scene.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

TEST_CASE("poses that a run learned are a capture that another run learns from") {
  const fs::path run = scratch() / "poses", capture = scratch() / "poses-capture";
  const Outcome outcome =
      cloam_with({"train", "nerf", small_scene().string(), "-o", run.string(), "--steps", "30", "--set",
                  "poses.refine=true", "--set", "poses.warm_up=0", "--set", "batch.samples=2048", "--pictures", "off"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(contains(content_of(run / "metrics.jsonl"), "\"turned\":"));
  const Outcome written = cloam_with({"export", run.string(), "--format", "capture", "-o", capture.string(), "--json"});
  REQUIRE_MESSAGE(written.code == 0, written.err);
  const auto told = nlohmann::json::parse(written.out);
  CHECK(told.at("photos") == 10);
  CHECK(told.at("refined") == 8);
  CHECK(told.at("turned_degrees").get<double>() > 0.01);
  CHECK(told.at("turned_degrees").get<double>() < 5);
  const Outcome again = cloam_with({"train", "nerf", capture.string(), "-o", (scratch() / "poses-again").string(),
                                    "--steps", "2", "--pictures", "off", "--json"});
  CHECK_MESSAGE(again.code == 0, again.err);
}

namespace {

double psnr_of(const Words& eval) {
  Words words = eval;
  words.emplace_back("--json");
  const Outcome outcome = cloam_with(words);
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  return nlohmann::json::parse(outcome.out).at("psnr");
}

/// The run's own photos are measured as those of the capture that has what was learned of their cameras.
void check_measured_as(const fs::path& capture, const fs::path& run) {
  const double own = psnr_of({"eval", run.string()}),
               other = psnr_of({"eval", run.string(), "--data", capture.string()});
  CHECK(own == doctest::Approx(other));
}

}  // namespace

TEST_CASE("lenses that a run learned are those of the capture") {
  const fs::path run = scratch() / "focals", capture = scratch() / "focals-capture";
  const Outcome trained =
      cloam_with(small_training(small_scene(), run,
                                {"--steps", "20", "--set", "intrinsics.refine=true", "--set", "intrinsics.centres=true",
                                 "--set", "intrinsics.rate=0.1", "--preview-every", "20"}));
  REQUIRE_MESSAGE(trained.code == 0, trained.err);
  const Outcome written = cloam_with({"export", run.string(), "--format", "capture", "-o", capture.string(), "--json"});
  REQUIRE_MESSAGE(written.code == 0, written.err);
  CHECK_FALSE(contains(written.err, "poses that were learned"));
  const auto told = nlohmann::json::parse(written.out);
  const double percent = told.at("focal_percent"), pixels = told.at("centre_pixels");
  CHECK(percent > 0.01);
  CHECK(pixels > 0.01);
  const Camera given = read_scene(small_scene()).cameras.front(), learned = read_scene(capture).cameras.front();
  CHECK(std::abs(100 * std::abs(learned.fx / given.fx - 1) - percent) < 1e-3);
  CHECK(std::abs(learned.fx / given.fx - learned.fy / given.fy) < 1e-6);
  CHECK(std::abs(std::hypot(learned.cx - given.cx, learned.cy - given.cy) - pixels) < 1e-3);
  check_measured_as(capture, run);
  // So is the preview of the last step.
  const std::string events = content_of(run / "metrics.jsonl");
  const std::size_t from = events.rfind('\n', events.rfind("\"event\":\"eval\"")) + 1;
  const auto preview = nlohmann::json::parse(events.substr(from, events.find('\n', from) - from));
  CHECK(preview.at("step") == 20);
  const auto first = nlohmann::json::parse(content_of(run / "eval/eval.json")).at("per_image").at(0);
  CHECK(preview.at("psnr").get<double>() == doctest::Approx(first.at("psnr").get<double>()));
}

TEST_CASE("learned poses and lenses of a log's photos are a log") {
  for (const bool lenses : {false, true}) {
    const fs::path run = scratch() / (lenses ? "log-lenses" : "log-poses"), out = run.string() + "-out";
    Words how = {"--steps", "4", "--set", "poses.refine=true", "--set", "poses.warm_up=0"};
    if (lenses)
      how.insert(how.end(),
                 {"--set", "intrinsics.refine=true", "--set", "intrinsics.centres=true", "--set", "intrinsics.rate=1"});
    const Outcome trained = cloam_with(small_training(small_street(), run, how));
    REQUIRE_MESSAGE(trained.code == 0, trained.err);
    const Outcome written = cloam_with({"export", run.string(), "--format", "capture", "-o", out.string()});
    REQUIRE_MESSAGE(written.code == 0, written.err);
    const Scene given = read_scene(small_street()), learned = read_scene(out);
    CHECK(learned.frames.size() == 3);
    CHECK(learned.sweeps.size() == given.sweeps.size());
    CHECK((learned.frames[0].world_from_camera - given.frames[0].world_from_camera).norm() > 1e-5);
    CHECK((learned.sweeps[0].world_from_lidar - given.sweeps[0].world_from_lidar).norm() == 0);
    const double factor = learned.cameras[0].fx / given.cameras[0].fx;
    CHECK((std::abs(factor - 1) > 1e-6) == lenses);
    CHECK(learned.cameras[0].fy / given.cameras[0].fy == doctest::Approx(factor));
    CHECK((learned.cameras[0].cx != given.cameras[0].cx) == lenses);
    check_measured_as(out, run);
  }
}

TEST_CASE("a log whose files have no room for learned cameras is written anew, with its boxes") {
  const fs::path logs = scratch() / "as-recorded", run = scratch() / "anew", out = scratch() / "anew-out";
  const Outcome made = cloam_with({"synth", "-o", logs.string(), "--logs", "1", "--frames", "3", "--size", "48x27",
                                   "--cameras", "front", "--beams", "24", "--as-recorded", "--no-truth", "-q"});
  REQUIRE_MESSAGE(made.code == 0, made.err);
  const Outcome trained =
      cloam_with({"train", "street-gaussians", (logs / "001").string(), "-o", run.string(), "--preset",
                  "street-gaussians-small", "--steps", "4", "--pictures", "off", "--set", "poses.refine=true", "--set",
                  "poses.warm_up=0", "--set", "intrinsics.refine=true", "--set", "intrinsics.rate=1"});
  REQUIRE_MESSAGE(trained.code == 0, trained.err);
  const Outcome written = cloam_with({"export", run.string(), "--format", "capture", "-o", out.string(), "--json"});
  REQUIRE_MESSAGE(written.code == 0, written.err);
  CHECK(nlohmann::json::parse(written.out).at("boxes_refined").get<int>() > 0);
  const Scene given = read_scene(logs / "001"), learned = read_scene(out);
  CHECK((learned.frames[0].world_from_camera - given.frames[0].world_from_camera).norm() > 1e-5);
  CHECK((learned.sweeps[0].world_from_lidar - given.sweeps[0].world_from_lidar).norm() < 1e-9);
  check_measured_as(out, run);
  const Outcome again = cloam_with({"export", run.string(), "--format", "capture", "-o", out.string()});
  CHECK(again.code == 2);
  CHECK_MESSAGE(contains(again.err, "exists; name a new folder with -o"), again.err);
}

TEST_CASE("a capture is not written of a run that learned the cameras of two logs") {
  const fs::path run = scratch() / "two-logs", out = scratch() / "two-logs-out", log = small_street();
  const Outcome trained =
      cloam_with({"train", "genassets", log.string(), log.string(), "-o", run.string(), "--preset", "genassets-small",
                  "--steps", "1", "--set", "intrinsics.refine=true", "--pictures", "off"});
  REQUIRE_MESSAGE(trained.code == 0, trained.err);
  const Outcome outcome = cloam_with({"export", run.string(), "--format", "capture", "-o", out.string()});
  CHECK(outcome.code == 2);
  CHECK_MESSAGE(contains(outcome.err, "learned the cameras or boxes of 2 logs"), outcome.err);
  CHECK(!fs::exists(out));
}

TEST_CASE("a run that left poses as they are has no capture to write") {
  const fs::path out = scratch() / "no-capture";
  const Outcome outcome = cloam_with({"export", small_run().string(), "--format", "capture", "-o", out.string()});
  CHECK(outcome.code == 2);
  CHECK_MESSAGE(contains(outcome.err, "learned neither poses, lenses nor boxes"), outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "poses.refine=true"), outcome.err);
  CHECK(!fs::exists(out));
}
