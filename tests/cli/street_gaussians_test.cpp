// Street Gaussians through the program: a street learnt for a moment, measured, edited, simulated.
#include <doctest/doctest.h>

#include <nlohmann/json.hpp>

#include "models/data/actor_masks.h"
#include "models/data/read_scene.h"
#include "models/gaussians/formats.h"
#include "models/io/image.h"
#include "models/io/safetensors.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"
#include "tests/cli/small_trainings.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

const fs::path& gaussian_street() {
  static const fs::path run = [] {
    const fs::path folder = scratch() / "gaussian_street";
    const auto training = std::ranges::find_if(
        small_trainings(), [](const SmallTraining& one) { return one.method == std::string("street-gaussians"); });
    const Outcome trained =
        cloam_with(training->words(folder, {"--steps", "8", "--holdout", "3", "--set", "initial.fewest=150"}));
    REQUIRE_MESSAGE(trained.code == 0, trained.err);
    return folder;
  }();
  return run;
}

std::vector<int> box_pixels(const Scene& log, const Actor& actor, const Frame& frame, double stretch) {
  const auto pose = world_from_box_at(actor, frame.timestamp.value_or(0));
  if (!pose) return {};
  const PlacedBox box{1, actor.size * stretch, *pose};
  return outlines({box}, log.cameras[static_cast<std::size_t>(frame.camera)], frame.world_from_camera).actors;
}

/// The one whose box has most pixels in a frame.
const Actor& largest_in(const Scene& log, const Frame& frame) {
  const Actor* largest = nullptr;
  std::ptrdiff_t most = 20;
  for (const Actor& actor : log.actors) {
    const std::vector<int> pixels = box_pixels(log, actor, frame, 1);
    if (const auto count = std::count(pixels.begin(), pixels.end(), 1); count > most) most = count, largest = &actor;
  }
  REQUIRE(largest);
  return *largest;
}

}  // namespace

TEST_CASE("street-gaussians: eval measures actors and LiDAR, edit lists the actors") {
  const Outcome evaluated = cloam_with({"eval", gaussian_street().string(), "--json"});
  REQUIRE_MESSAGE(evaluated.code == 0, evaluated.err);
  const auto json = nlohmann::json::parse(evaluated.out);
  for (const char* key : {"psnr", "masked_psnr", "lidar_median_error_m", "lidar_chamfer_m2"}) {
    CAPTURE(key);
    CHECK(json.at(key).is_number());
  }
  const Outcome listed = cloam_with({"edit", gaussian_street().string(), "--list", "--json"});
  REQUIRE_MESSAGE(listed.code == 0, listed.err);
  CHECK(nlohmann::json::parse(listed.out).at("actors").size() == read_scene(small_street()).actors.size());
}

TEST_CASE("street-gaussians: who is removed is gone from pictures and sweeps, all around stays to the bit") {
  const Scene log = read_scene(small_street());
  const Frame& frame = log.frames.front();
  const Actor& removed = largest_in(log, frame);
  const fs::path edited = scratch() / "gaussian_removed";
  const Outcome edit =
      cloam_with({"edit", gaussian_street().string(), "--actor", removed.id + ":remove", "-o", edited.string()});
  REQUIRE_MESSAGE(edit.code == 0, edit.err);
  std::vector<Image> pictures;
  for (const fs::path& run : {gaussian_street(), edited}) {
    const fs::path out = scratch() / ("pictures_of_" + run.filename().string());
    const Outcome rendered = cloam_with({"render", run.string(), "-o", out.string(), "--step", "0", "--masks"});
    REQUIRE_MESSAGE(rendered.code == 0, rendered.err);
    for (const auto& entry : fs::directory_iterator(out))
      if (entry.path().extension() == ".png" && !contains(entry.path().string(), "_actor"))
        pictures.push_back(read_image(entry.path()));
  }
  REQUIRE(pictures.size() == 2);
  const std::vector<int> inside = box_pixels(log, removed, frame, 1), around = box_pixels(log, removed, frame, 2);
  std::size_t changed = 0, beside = 0;
  for (std::size_t i = 0; i < inside.size(); ++i) {
    bool differs = false;
    const std::size_t channels = pictures[0].pixels.size() / inside.size();
    for (std::size_t c = 0; c < channels; ++c)
      differs |= pictures[0].pixels[channels * i + c] != pictures[1].pixels[channels * i + c];
    changed += differs && inside[i];
    beside += differs && !around[i];
  }
  CHECK(changed > static_cast<std::size_t>(std::count(inside.begin(), inside.end(), 1)) / 2);
  CHECK(beside == 0);
  const fs::path out = scratch() / "gaussian_removed_log";
  const Outcome simulated = cloam_with({"simulate", edited.string(), "-o", out.string(), "--json"});
  REQUIRE_MESSAGE(simulated.code == 0, simulated.err);
  CHECK(nlohmann::json::parse(simulated.out).at("returns_changed") > 0);
  const Scene after = read_scene(out);
  CHECK(after.actors.size() + 1 == log.actors.size());
  CHECK(cloam_with({"check", out.string()}).code == 0);
}

TEST_CASE("street-gaussians: what it is not for is told") {
  const Outcome photos = cloam_with({"train", "street-gaussians", small_scene().string(), "--dry-run"});
  CHECK(photos.code == 3);
  CHECK_MESSAGE(contains(photos.err, "street-gaussians learns driving logs; for photos, use train splat"), photos.err);
  const std::string log = small_street().string();
  const Outcome two = cloam_with({"train", "street-gaussians", log, log, "--dry-run"});
  CHECK(two.code == 2);
  CHECK_MESSAGE(contains(two.err, "street-gaussians trains on one log, not 2"), two.err);
}

TEST_CASE("street-gaussians: export writes the background and every actor in its box, as files that read back") {
  const fs::path folder = scratch() / "gaussian_files";
  const Outcome exported = cloam_with({"export", gaussian_street().string(), "-o", folder.string(), "--json"});
  REQUIRE_MESSAGE(exported.code == 0, exported.err);
  const auto json = nlohmann::json::parse(exported.out);
  const SafetensorsFile trained = read_safetensors(gaussian_street() / "ckpt" / "000008.safetensors");
  const auto learned = [&](const std::string& part) {
    return trained.tensors.at("param." + part + ".opacities").shape[0];
  };
  CHECK(json.at("background").at("gaussians") == learned("background"));
  CHECK(read_gaussians(folder / "background.ply").gaussians.count() == static_cast<std::size_t>(learned("background")));
  const Scene log = read_scene(small_street());
  std::int64_t all = 0, inside = 0;
  for (const auto& row : json.at("actors")) {
    const Gaussians gaussians = read_gaussians(row.at("path").get<std::string>()).gaussians;
    CHECK(row.at("gaussians") == gaussians.count());
    all += row.at("gaussians").get<std::int64_t>();
    const auto actor = std::ranges::find_if(log.actors, [&](const Actor& a) { return a.id == row.at("actor"); });
    REQUIRE(actor != log.actors.end());
    for (std::size_t i = 0; i < gaussians.means.size(); ++i)
      inside += std::abs(double{gaussians.means[i]}) < actor->size[static_cast<Eigen::Index>(i % 3)] / 2 + 0.2;
  }
  CHECK(static_cast<double>(inside) > 0.95 * 3 * static_cast<double>(all));  // but for halves of the last growth
  CHECK(all == learned("actors"));
  const std::string one = json.at("actors").at(0).at("actor");
  const fs::path file = scratch() / "gaussian_actor.spz";
  const Outcome single =
      cloam_with({"export", gaussian_street().string(), "--actor", one, "-o", file.string(), "--json"});
  REQUIRE_MESSAGE(single.code == 0, single.err);
  CHECK(read_gaussians(file).gaussians.count() == json.at("actors").at(0).at("gaussians").get<std::size_t>());
  const fs::path packed = scratch() / "background.compressed.ply";
  const Outcome alone = cloam_with({"export", gaussian_street().string(), "--background", "-o", packed.string()});
  REQUIRE_MESSAGE(alone.code == 0, alone.err);
  CHECK(content_of(packed).find("element chunk ") < 200);
  CHECK(read_gaussians(packed).gaussians.count() == static_cast<std::size_t>(learned("background")));
}

TEST_CASE("street-gaussians: an actor takes the looks of an actor of another run, which may be gone afterwards") {
  const fs::path other = scratch() / "gaussian_other";
  const auto training = std::ranges::find_if(
      small_trainings(), [](const SmallTraining& one) { return one.method == std::string("street-gaussians"); });
  const Outcome trained = cloam_with(
      training->words(other, {"--steps", "4", "--seed", "7", "--set", "initial.fewest=90", "--set", "actors.waves=2"}));
  REQUIRE_MESSAGE(trained.code == 0, trained.err);
  const Scene log = read_scene(small_street());
  const Frame& frame = log.frames.front();
  const Actor& wearer = largest_in(log, frame);
  const Actor& worn = *std::ranges::find_if(log.actors, [&](const Actor& a) { return a.id != wearer.id; });
  const auto exported = [&](const fs::path& run, const std::string& actor, const char* name) {
    const fs::path file = scratch() / name;
    const Outcome outcome = cloam_with({"export", run.string(), "--actor", actor, "-o", file.string()});
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    return read_gaussians(file).gaussians;
  };
  const Gaussians looks = exported(other, worn.id, "gaussian_worn.ply");
  const fs::path edited = scratch() / "gaussian_exchanged";
  const Outcome edit = cloam_with({"edit", gaussian_street().string(), "--actor",
                                   wearer.id + ":replace=" + other.string() + ":" + worn.id, "-o", edited.string()});
  REQUIRE_MESSAGE(edit.code == 0, edit.err);
  fs::remove_all(other);
  const Gaussians taken = exported(edited, worn.id + "-2", "gaussian_taken.ply");
  CHECK(taken.means == looks.means);
  CHECK(taken.sh_first == looks.sh_first);
  CHECK(taken.opacities == looks.opacities);
  CHECK(exported(edited, worn.id, "gaussian_own.ply").means ==
        exported(gaussian_street(), worn.id, "gaussian_own_before.ply").means);
  const auto picture_of = [&](const fs::path& run) {
    const fs::path out = scratch() / ("exchange_of_" + run.filename().string());
    const Outcome rendered = cloam_with({"render", run.string(), "-o", out.string(), "--step", "0"});
    REQUIRE_MESSAGE(rendered.code == 0, rendered.err);
    for (const auto& entry : fs::directory_iterator(out))
      if (entry.path().extension() == ".png") return read_image(entry.path());
    FAIL("no picture");
    return Image();
  };
  const Image before = picture_of(gaussian_street()), after = picture_of(edited);
  const std::vector<int> around = box_pixels(log, wearer, frame, 3);
  const std::size_t channels = before.pixels.size() / around.size();
  std::size_t changed = 0, beside = 0;
  for (std::size_t at = 0; at < before.pixels.size(); ++at)
    (around[at / channels] ? changed : beside) += before.pixels[at] != after.pixels[at];
  CHECK(changed > 30);
  CHECK(beside == 0);
  const Outcome listed = cloam_with({"edit", edited.string(), "--list", "--json"});
  CHECK_MESSAGE(listed.code == 0, listed.err);
}

TEST_CASE("street-gaussians: looks that it cannot take are refused with what it can") {
  const std::string id = read_scene(small_street()).actors.front().id;
  const fs::path never = scratch() / "gaussian_never";
  const auto refused = [&](const fs::path& run, const std::string& operation, const std::string& says) {
    const Outcome outcome = cloam_with({"edit", run.string(), "--actor", id + ":" + operation, "-o", never.string()});
    CHECK(outcome.code == 2);
    CHECK_MESSAGE(contains(outcome.err, says), outcome.err);
    CHECK_FALSE(fs::exists(never));
  };
  const std::string street = gaussian_street().string();
  refused(street, "replace=generated", "replace=RUN:ID");
  refused(street, "replace=" + street + ":nobody", "nobody");
  refused(small_street_run(), "replace=" + street + ":" + id, "is a run of genassets");
}

TEST_CASE("street-gaussians: boxes that were learned are a log that another run learns from") {
  const fs::path run = scratch() / "boxes", log = scratch() / "boxes-log";
  const auto training = std::ranges::find_if(
      small_trainings(), [](const SmallTraining& one) { return one.method == std::string("street-gaussians"); });
  const Outcome trained =
      cloam_with(training->words(run, {"--steps", "6", "--set", "actors.refine=true", "--set",
                                       "train.rate_positions=0.02", "--set", "weight.smooth=1e-4"}));
  REQUIRE_MESSAGE(trained.code == 0, trained.err);
  const Outcome written = cloam_with({"export", run.string(), "--format", "capture", "-o", log.string(), "--json"});
  REQUIRE_MESSAGE(written.code == 0, written.err);
  const auto json = nlohmann::json::parse(written.out);
  const Scene given = read_scene(small_street()), refined = read_scene(log);
  REQUIRE(refined.actors.size() == given.actors.size());
  std::vector<double> shifts;
  for (std::size_t a = 0; a < given.actors.size(); ++a)
    for (std::size_t b = 0; b < given.actors[a].boxes.size(); ++b) {
      const double shift = (refined.actors[a].boxes.at(b).world_from_box - given.actors[a].boxes[b].world_from_box)
                               .topRightCorner<3, 1>()
                               .norm();
      if (shift > 0) shifts.push_back(shift);
    }
  std::ranges::sort(shifts);
  REQUIRE(!shifts.empty());
  CHECK(json.at("boxes_refined") == shifts.size());
  CHECK(json.at("median_shift_m").get<double>() == doctest::Approx(shifts[shifts.size() / 2]).epsilon(1e-6));
  CHECK(shifts.back() < 0.3);  // six steps of 0.02 m, in each of three directions
  CHECK(cloam_with({"check", log.string()}).code == 0);
}
