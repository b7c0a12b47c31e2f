// NeuRAD through the program: a street learnt for a moment, measured, edited, simulated, exported.
#include <doctest/doctest.h>

#include <nlohmann/json.hpp>

#include "models/data/read_scene.h"
#include "models/io/ply.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"
#include "tests/cli/small_trainings.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

const fs::path& neurad_street() {
  static const fs::path run = [] {
    const fs::path folder = scratch() / "neurad_street";
    const auto training = std::ranges::find_if(
        small_trainings(), [](const SmallTraining& one) { return one.method == std::string("neurad"); });
    const Outcome trained = cloam_with(training->words(folder, {"--steps", "8", "--holdout", "3"}));
    REQUIRE_MESSAGE(trained.code == 0, trained.err);
    return folder;
  }();
  return run;
}

nlohmann::json json_of(const std::vector<std::string>& words) {
  const Outcome outcome = cloam_with(words);
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  return nlohmann::json::parse(outcome.out);
}

}  // namespace

TEST_CASE("neurad: a run is measured, its sweeps and masks are rendered, an actor is a mesh") {
  const std::string run = neurad_street().string();
  const auto measured = json_of({"eval", run, "--json"});
  for (const char* key : {"psnr", "masked_psnr", "lidar_median_error_m", "lidar_chamfer_m2",
                          "lidar_median_squared_error_m2", "lidar_intensity_rmse", "baseline_mean_intensity_rmse",
                          "ray_drop_accuracy", "ray_drop_balanced_accuracy", "baseline_ray_drop_accuracy"}) {
    CAPTURE(key);
    CHECK(measured.at(key).is_number());
  }
  const fs::path out = scratch() / "neurad_sweeps";
  CHECK(json_of({"render", run, "-o", out.string(), "--lidar", "--json"}).at("sweeps") > 0);
  for (const auto& entry : fs::directory_iterator(out)) {
    const PlyVertices sweep = read_ply_vertices(entry.path());
    REQUIRE(sweep.find("drop"));
    for (const char* name : {"intensity", "drop"})
      for (const float value : sweep.column(name)) CHECK((value >= 0 && value <= 1));
  }
  const Scene log = read_scene(small_street());
  const fs::path pictures = scratch() / "neurad_pictures";
  REQUIRE(cloam_with({"render", run, "-o", pictures.string(), "--step", "0", "--masks"}).code == 0);
  CHECK(fs::exists(pictures / "actors.json"));
  const auto listed = json_of({"edit", run, "--list", "--json"}).at("actors");
  CHECK(listed.size() == log.actors.size());
  const fs::path mesh = scratch() / "neurad_actor.glb";
  const Outcome exported = cloam_with(
      {"export", run, "--actor", log.actors.front().id, "--format", "glb", "--resolution", "8", "-o", mesh.string()});
  CHECK_MESSAGE((exported.code == 0 || contains(exported.err, "no surface")), exported.err);
}

TEST_CASE("neurad: an edited street is a log whose LiDAR and pictures follow the edit") {
  const Scene log = read_scene(small_street());
  const fs::path edited = scratch() / "neurad_edited", out = scratch() / "neurad_log";
  const std::string id = log.actors.front().id;
  REQUIRE(
      cloam_with({"edit", neurad_street().string(), "--actor", id + ":shift=0/2/0,rotate=30", "-o", edited.string()})
          .code == 0);
  CHECK(json_of({"simulate", edited.string(), "-o", out.string(), "--json"}).at("images") > 0);
  CHECK(cloam_with({"check", out.string()}).code == 0);
  CHECK(read_scene(out).actors.size() == log.actors.size());
}

TEST_CASE("neurad: boxes that were learned are resumed to the same bytes, go with an edit and are written as a log") {
  const auto training = std::ranges::find_if(
      small_trainings(), [](const SmallTraining& one) { return one.method == std::string("neurad"); });
  const fs::path whole = scratch() / "neurad_boxes", stopped = scratch() / "neurad_boxes_stopped";
  const std::vector<std::string> settings = {"--steps", "6",
                                             "--set",   "actors.refine=true",
                                             "--set",   "train.rate_positions=0.02",
                                             "--set",   "weight.smooth=1e-4",
                                             "--set",   "poses.refine=true"};
  REQUIRE(cloam_with(training->words(whole, settings)).code == 0);
  std::vector<std::string> first = settings;
  first.insert(first.end(), {"--stop-after", "3"});
  REQUIRE(cloam_with(training->words(stopped, first)).code == 0);
  REQUIRE(cloam_with({"train", "--resume", stopped.string(), "--pictures", "off"}).code == 0);
  CHECK(content_of(whole / "ckpt/000006.safetensors") == content_of(stopped / "ckpt/000006.safetensors"));

  const Scene given = read_scene(small_street());
  const fs::path edited = scratch() / "neurad_boxes_edited", picture = scratch() / "neurad_boxes_pictures";
  REQUIRE(cloam_with({"edit", whole.string(), "--actor", given.actors.front().id + ":remove", "-o", edited.string()})
              .code == 0);
  const Outcome rendered = cloam_with({"render", edited.string(), "-o", picture.string(), "--step", "0"});
  CHECK_MESSAGE(rendered.code == 0, rendered.err);

  const fs::path log = scratch() / "neurad_boxes_log";
  const auto told = json_of({"export", whole.string(), "--format", "capture", "-o", log.string(), "--json"});
  CHECK(told.at("refined") > 0);  // photos, in the same log
  const Scene refined = read_scene(log);
  REQUIRE(refined.actors.size() == given.actors.size());
  std::size_t moved = 0;
  for (std::size_t a = 0; a < given.actors.size(); ++a)
    for (std::size_t b = 0; b < given.actors[a].boxes.size(); ++b) {
      const Eigen::Matrix4d by = refined.actors[a].boxes.at(b).world_from_box - given.actors[a].boxes[b].world_from_box;
      moved += by.norm() > 1e-6;
      CHECK(by.topRightCorner<3, 1>().norm() < 0.3);  // six steps of 0.02 m, in each of three directions
    }
  CHECK(moved > 0);
  CHECK(told.at("boxes_refined") >= moved);
  CHECK(cloam_with({"check", log.string()}).code == 0);

  const fs::path simulated = scratch() / "neurad_boxes_simulated";
  REQUIRE(cloam_with({"simulate", whole.string(), "-o", simulated.string()}).code == 0);
  const Scene shown = read_scene(simulated);
  REQUIRE(shown.actors.size() == refined.actors.size());
  for (std::size_t a = 0; a < shown.actors.size(); ++a)
    for (std::size_t b = 0; b < shown.actors[a].boxes.size(); ++b)
      CHECK((shown.actors[a].boxes[b].world_from_box - refined.actors[a].boxes.at(b).world_from_box).norm() < 1e-4);
}

TEST_CASE("neurad: what it is not for is told") {
  const Outcome photos = cloam_with({"train", "neurad", small_scene().string(), "--dry-run"});
  CHECK(photos.code == 3);
  CHECK_MESSAGE(contains(photos.err, "neurad learns driving logs; for photos, use train nerf"), photos.err);
  const std::string log = small_street().string();
  const Outcome two = cloam_with({"train", "neurad", log, log, "--dry-run"});
  CHECK(two.code == 2);
  CHECK_MESSAGE(contains(two.err, "neurad trains on one log, not 2"), two.err);
  const Outcome grids =
      cloam_with({"train", "neurad", log, "--dry-run", "--set", "actors.levels=6", "--set", "grid.levels=2", "--set",
                  "weight.perceptual=0", "--set", "grid.log2_rows=8", "--set", "actors.log2_rows=8"});
  CHECK(grids.code == 2);
  CHECK_MESSAGE(contains(grids.err, "the actors' grid says 24 numbers of a point, the background's 8"), grids.err);
}
