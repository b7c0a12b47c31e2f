// Gaussian splatting through the real program: training, resuming, files, and what is told when it cannot be.
#include <doctest/doctest.h>

#include <csignal>
#include <nlohmann/json.hpp>
#include <set>

#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

Words training(const fs::path& run, const Words& more) {
  Words words = {"train",          "splat", small_scene().string(), "-o",    run.string(),      "--progress",
                 "plain",          "--set", "initial.random=300",   "--set", "growth.start=20", "--set",
                 "growth.every=20"};
  words.insert(words.end(), more.begin(), more.end());
  return without_pictures(words);
}

const fs::path& trained() {
  static const fs::path run = [] {
    const fs::path folder = scratch() / "splats";
    const Outcome outcome = cloam_with(training(folder, {"--steps", "150"}));
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    CHECK(contains(outcome.err, "k gaussians"));
    return folder;
  }();
  return run;
}

}  // namespace

TEST_CASE("splat: trained, measured, and its test pictures beat a mean colour") {
  const Outcome outcome = cloam_with({"eval", trained().string(), "--json"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  const auto json = nlohmann::json::parse(outcome.out);
  CHECK(json.at("method") == "splat");
  CHECK(json.at("psnr").get<double>() > json.at("baseline_mean_colour_psnr").get<double>() + 3);
}

TEST_CASE("splat: pictures of depth, normals, opacity and ellipsoids, each of its own") {
  std::set<std::string> files;
  for (const char* what : {"colour", "depth", "normals", "opacity", "ellipsoids"}) {
    const fs::path out = scratch() / (std::string("drawn-") + what);
    const Outcome outcome = cloam_with({"render", trained().string(), "-o", out.string(), "--draw", what});
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    for (const auto& entry : fs::directory_iterator(out)) files.insert(content_of(entry.path()));
  }
  const auto views = static_cast<size_t>(std::distance(fs::directory_iterator(scratch() / "drawn-depth"), {}));
  CHECK(files.size() == 5 * views);
  const Outcome refused =
      cloam_with({"render", small_run().string(), "-o", (scratch() / "never-drawn").string(), "--draw", "ellipsoids"});
  CHECK(refused.code == 2);
  CHECK_MESSAGE(contains(refused.err, "shows the Gaussians of a run of splat or street-gaussians"), refused.err);
  const Outcome without_rays =
      cloam_with({"render", trained().string(), "-o", (scratch() / "never-drawn").string(), "--draw", "samples"});
  CHECK(without_rays.code == 2);
  CHECK_MESSAGE(contains(without_rays.err, "a run of nerf samples its rays; the run's method is splat"),
                without_rays.err);
  const fs::path rays = scratch() / "drawn-samples";
  CHECK(cloam_with({"render", small_run().string(), "-o", rays.string(), "--draw", "samples"}).code == 0);
  CHECK(!fs::is_empty(rays));
}

TEST_CASE("splat: exported in every format, read again, and drawn like the model") {
  const std::pair<const char*, double> formats[] = {{"ply", 1000}, {"glb", 60}, {"spz", 25}, {"splat", 15}};
  for (const auto& [format, least] : formats) {
    const fs::path file = scratch() / (std::string("scene.") + format);
    const Outcome outcome = cloam_with({"export", trained().string(), "-o", file.string(), "--json"});
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    const auto json = nlohmann::json::parse(outcome.out);
    CHECK(json.at("gaussians").get<int>() >= 100);
    const auto psnr = json.at("psnr_to_model");  // null: equal to the bit
    CHECK_MESSAGE((psnr.is_null() || psnr.get<double>() > least), format, " ", psnr.dump());
    CHECK(psnr.is_null() == (std::string(format) == "ply"));
  }
  // Training goes on from any such file.
  const Outcome again = cloam_with(training(
      scratch() / "splats-from-file", {"--steps", "2", "--set", "initial=" + (scratch() / "scene.ply").string()}));
  CHECK_MESSAGE(again.code == 0, again.err);
  CHECK(cloam_with({"eval", (scratch() / "splats-from-file").string()}).code == 0);
}

TEST_CASE("splat: stopped and resumed ends in the bytes of one that was left alone") {
  const fs::path run = scratch() / "splats-stopped";
  REQUIRE(cloam_with(training(run, {"--steps", "150", "--stop-after", "45"})).code == 0);
  const Outcome resumed = cloam_with({"train", "--resume", run.string(), "--pictures", "off"});
  REQUIRE_MESSAGE(resumed.code == 0, resumed.err);
  CHECK(content_of(run / "ckpt" / "000150.safetensors") == content_of(trained() / "ckpt" / "000150.safetensors"));
}

TEST_CASE("splat: killed between two growths and resumed ends in the same bytes; a damaged checkpoint is passed over") {
  const fs::path run = scratch() / "splats-killed";
  Process process(training(run, {"--steps", "150", "--save-every", "10"}));
  REQUIRE(wait_for(run / "ckpt" / "000030.safetensors", process));
  process.signal(SIGKILL);
  CHECK(process.wait().code == -SIGKILL);
  // Not the newest file: it may have been killed before that was named.
  std::string name = content_of(run / "ckpt" / "latest.txt");
  name.erase(name.find_last_not_of('\n') + 1);
  const fs::path newest = run / "ckpt" / name;
  fs::resize_file(newest, fs::file_size(newest) - 5);
  const Outcome resumed = cloam_with({"train", "--resume", run.string(), "--pictures", "off"});
  REQUIRE_MESSAGE(resumed.code == 0, resumed.err);
  CHECK_MESSAGE(contains(resumed.err, newest.filename().string()), resumed.err);
  CHECK(content_of(run / "ckpt" / "000150.safetensors") == content_of(trained() / "ckpt" / "000150.safetensors"));
}

TEST_CASE("splat: what does not fit or cannot be is told before anything is done") {
  const fs::path run = scratch() / "splats-never";
  const Outcome large = cloam_with(training(run, {"--max-memory", "300M", "--set", "growth.max=2000000"}));
  CHECK(large.code == 5);
  const std::string advice = "growth.max=";
  const size_t at = large.err.find(advice);
  REQUIRE_MESSAGE(at != std::string::npos, large.err);
  const std::string most = std::to_string(std::stoll(large.err.substr(at + advice.size())));
  CHECK(cloam_with(training(run, {"--max-memory", "300M", "--dry-run", "--set", advice + most})).code == 0);
  const struct {
    const char *setting, *hint;
  } rows[] = {{"initial=points", "initial=random"},
              {"initial=everywhere", "want auto"},
              {"initial=no-such.ply", "no-such.ply"},
              {"growth.strategy=densfy", "densify or mcmc"},
              {"sh.degree=4", "0 to 3"},
              {"growth.mots=5", "growth.max"}};
  for (const auto& row : rows) {
    const Outcome outcome = cloam_with(training(run, {"--steps", "2", "--set", row.setting}));
    CHECK_MESSAGE((outcome.code == 2 || outcome.code == 3), row.setting, " ", outcome.code, " ", outcome.err);
    CHECK_MESSAGE(contains(outcome.err, row.hint), outcome.err);
  }
  const fs::path file = scratch() / "model.splat";
  CHECK(cloam_with({"export", trained().string(), "-o", file.string(), "--actor", "a"}).code == 2);
  CHECK(cloam_with({"export", trained().string(), "-o", file.string(), "--format", "plly"}).code == 2);
  CHECK(cloam_with({"export", trained().string(), "-o", file.string(), "--format", "spz"}).code == 2);
  CHECK(!fs::exists(file.string() + ".spz"));
  CHECK(!fs::exists(file));
}
