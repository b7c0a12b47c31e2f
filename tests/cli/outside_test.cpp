// Captures whose lists name photos outside of their folder: what has to be allowed, and what a run remembers of it.
#include <doctest/doctest.h>

#include <nlohmann/json.hpp>

#include "tests/cli/process.h"
#include "tests/models/errors.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// A copy of the small scene whose photos lie elsewhere: the training photos by absolute paths, the test ones by `..`.
fs::path scene_with_photos_outside(const std::string& name) {
  const fs::path data = copy_of_scene(name), photos = scratch() / (name + "-photos");
  fs::create_directories(photos);
  for (const std::string split : {"train", "test"}) {
    fs::rename(data / split, photos / split);
    const fs::path list = data / ("transforms_" + split + ".json");
    auto json = json_of(list);
    for (auto& frame : json["frames"]) {
      const std::string file = fs::path(frame["file_path"].get<std::string>()).filename().string();
      frame["file_path"] = split == "train" ? (photos / split / file).string()
                                            : "../" + photos.filename().string() + "/" + split + "/" + file;
    }
    write_text(list, json.dump());
  }
  return data;
}

}  // namespace

TEST_CASE("photos outside of the folder: refused with the option named; a run that was allowed reads them again") {
  const fs::path data = scene_with_photos_outside("outside"), run = scratch() / "outside-run";
  const auto refused = [](const Words& words) {
    const Outcome outcome = cloam_with(words);
    CHECK_MESSAGE(outcome.code == 3, outcome.err);
    CHECK_MESSAGE(holds(outcome.err, "--allow-outside"), outcome.err);
  };
  const auto done = [](const Words& words) {
    const Outcome outcome = cloam_with(words);
    CHECK_MESSAGE(outcome.code == 0, outcome.err);
    return outcome;
  };
  refused({"check", data.string()});
  refused(small_training(data, run, {"--steps", "4"}));
  CHECK_FALSE(fs::exists(run));
  const Outcome checked = done({"check", data.string(), "--allow-outside"});
  CHECK(holds(checked.err, "next: cloam train nerf " + data.string() + " --allow-outside"));
  done(small_training(data, run, {"--steps", "4", "--stop-after", "2", "--allow-outside"}));
  CHECK(json_of(run / "run.json").at("reading").at("allow_outside") == true);
  done({"train", "--resume", run.string(), "--pictures", "off"});
  CHECK(json_of(run / "run.json").at("state") == "finished");
  const auto figures = nlohmann::json::parse(done({"eval", run.string(), "--json"}).out);
  CHECK(figures.at("images") == 2);
  const std::string out = (scratch() / "outside-pictures").string();
  done({"render", run.string(), "-o", out, "--split", "all"});
  std::size_t pictures = 0;
  for (const auto& entry : fs::directory_iterator(out)) pictures += entry.path().extension() == ".png";
  CHECK(pictures == 10);
  // Other data are not allowed what the run's own were.
  refused({"eval", run.string(), "--data", data.string()});
  refused({"render", run.string(), "-o", out, "--data", data.string()});
  done({"eval", run.string(), "--data", data.string(), "--allow-outside"});
  done({"render", run.string(), "-o", out, "--data", data.string(), "--allow-outside"});
}
