// Generated assets in the street, through the program: actors that wear them, logs made with them, and what cannot be.
#include <doctest/doctest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "models/data/read_scene.h"
#include "models/io/safetensors.h"
#include "models/latents/new_assets.h"
#include "models/runs/scene_file.h"
#include "models/scene/asset_class.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// Ids of the cars of the first street that stand in it at all steps.
std::vector<std::string> cars() {
  std::vector<std::string> ids;
  const Scenes scenes = read_scene_file(two_streets_run() / "scene.json");
  for (const Actor& actor : scenes[0].actors)
    if (asset_class(actor.label) == 0 && actor.boxes.size() == 3) ids.push_back(actor.id);
  REQUIRE(ids.size() > 1);
  return ids;
}

Words edit_words(const fs::path& run, const std::string& actor, const fs::path& out, const Words& more = {}) {
  Words words = {"edit", run.string(), "--actor", "0:" + actor, "-o", out.string(), "-q"};
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

Outcome generate_into(const fs::path& run, const std::string& id, const fs::path& out, const std::string& seed) {
  return cloam_with(
      edit_words(run, id + ":replace=generated", out, {"--prior", small_diffusion_run().string(), "--seed", seed}));
}

/// The first street with its first pedestrian and car and a bus alone: each vehicle that is swapped takes its time.
const fs::path& few_actors_run() {
  static const fs::path run = [] {
    const fs::path folder = scratch() / "few_actors";
    const Scenes scenes = read_scene_file(two_streets_run() / "scene.json");
    Words words = {"edit", two_streets_run().string(), "-o", folder.string(), "-q"};
    std::set<std::string> kept;
    for (const Actor& actor : scenes[0].actors) {
      const bool is_kept = actor.label == "Car" || actor.label == "Pedestrian" || actor.label == "Bus";
      if (is_kept && kept.insert(actor.label).second) continue;
      words.insert(words.end(), {"--actor", "0:" + actor.id + ":remove"});
    }
    const Outcome outcome = cloam_with(words);
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    return folder;
  }();
  return run;
}

Words augment_words(const fs::path& out) {
  return {"simulate", few_actors_run().string(),      "-o",     out.string(), "--augment", "2",
          "--prior",  small_diffusion_run().string(), "--json", "--seed",     "5"};
}

const Actor& actor_in(const Scene& scene, const std::string& id) {
  const auto found = std::find_if(scene.actors.begin(), scene.actors.end(), [&](const Actor& a) { return a.id == id; });
  REQUIRE(found != scene.actors.end());
  return *found;
}

/// Way, place on the ground and height of its bottom.
bool stands_alike(const Actor& a, const Actor& b) {
  const auto alike = [&](const ActorBox& x, const ActorBox& y) {
    const Eigen::Vector3d apart = x.world_from_box.topRightCorner<3, 1>() - y.world_from_box.topRightCorner<3, 1>();
    return x.step == y.step && apart.head<2>().norm() < 1e-6 &&
           std::abs(apart.z() - (a.size.z() - b.size.z()) / 2) < 1e-6 &&
           x.world_from_box.topLeftCorner<3, 3>().isApprox(y.world_from_box.topLeftCorner<3, 3>(), 1e-6);
  };
  return std::equal(a.boxes.begin(), a.boxes.end(), b.boxes.begin(), b.boxes.end(), alike);
}

/// The first car of the first street in an asset of seed 7.
const fs::path& worn_run() {
  static const fs::path run = [] {
    const fs::path folder = scratch() / "worn";
    const Outcome outcome = generate_into(two_streets_run(), cars()[0], folder, "7");
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    return folder;
  }();
  return run;
}

}  // namespace

TEST_CASE("an actor takes a generated asset of its class; the same seed the same bytes, another others") {
  const std::string id = cars()[0];
  const fs::path first = worn_run(), again = scratch() / "worn_again", other = scratch() / "worn_other";
  const Scenes before = read_scene_file(two_streets_run() / "scene.json"),
               after = read_scene_file(first / "scene.json");
  const Actor &was = actor_in(before[0], id), &is = actor_in(after[0], id);
  CHECK(is.asset == AssetName{2, "generated"});
  CHECK(is.label == was.label);
  CHECK(stands_alike(is, was));
  const NewAssets made = read_new_assets(first / "generated.safetensors");
  REQUIRE(made.assets.size() == 1);
  CHECK(made.assets[0].asset_class == 0);
  CHECK(made.assets[0].night == before[0].night);
  CHECK(made.assets[0].size.isApprox(is.size, 1e-6));
  CHECK(contains(made.made.at("asset.0"), "diffusion, step 60, "));
  // Boxes are those of cars that training had: of both streets.
  bool is_known = false;
  for (const Scene& scene : before)
    for (const Actor& actor : scene.actors) is_known |= asset_class(actor.label) == 0 && actor.size.isApprox(is.size);
  CHECK(is_known);
  REQUIRE(generate_into(two_streets_run(), id, again, "7").code == 0);
  for (const char* name : {"scene.json", "generated.safetensors"})
    CHECK_MESSAGE(content_of(again / name) == content_of(first / name), name);
  REQUIRE(generate_into(two_streets_run(), id, other, "8").code == 0);
  CHECK(read_new_assets(other / "generated.safetensors").assets[0].code != made.assets[0].code);
}

TEST_CASE("a run with a generated asset stands alone: it is seen, listed, exported and edited again") {
  const std::vector<std::string> ids = cars();
  const fs::path once = worn_run(), twice = scratch() / "twice_worn", swapped = scratch() / "worn_by_two";
  const Outcome second = generate_into(once, ids[1], twice, "7");
  REQUIRE_MESSAGE(second.code == 0, second.err);
  const NewAssets of_one = read_new_assets(once / "generated.safetensors"),
                  of_two = read_new_assets(twice / "generated.safetensors");
  REQUIRE(of_two.assets.size() == 2);
  CHECK(of_two.assets[0].code == of_one.assets[0].code);
  CHECK(of_two.assets[1].code != of_one.assets[0].code);  // each actor its own
  CHECK(actor_in(read_scene_file(twice / "scene.json")[0], ids[1]).asset == AssetName{3, "generated"});
  // An edit without a prior keeps what there is, and gives it to others.
  REQUIRE(cloam_with(edit_words(twice, ids[0] + ":replace=0:" + ids[1], swapped)).code == 0);
  CHECK(content_of(swapped / "generated.safetensors") == content_of(twice / "generated.safetensors"));
  CHECK(actor_in(read_scene_file(swapped / "scene.json")[0], ids[0]).asset == AssetName{3, "generated"});
  const Outcome listed = cloam_with({"edit", twice.string(), "--list", "--json"});
  REQUIRE_MESSAGE(listed.code == 0, listed.err);
  int generated = 0;
  const auto json = nlohmann::json::parse(listed.out);
  for (const auto& row : json.at("actors"))
    generated += row.at("looks_of").is_string() && contains(row.at("looks_of"), "generated ");
  CHECK(generated == 2);
  const fs::path mesh = scratch() / "worn.glb", own = scratch() / "own.glb";
  for (const auto& [run, path] : {std::pair{twice, mesh}, {two_streets_run(), own}}) {
    const Outcome outcome =
        cloam_with({"export", run.string(), "--actor", "0:" + ids[0], "-o", path.string(), "--resolution", "8", "-q"});
    CHECK_MESSAGE(outcome.code == 0, outcome.err);
  }
  CHECK(content_of(mesh) != content_of(own));
  CHECK(cloam_with({"train", "diffusion", twice.string(), "-o", (scratch() / "never").string()}).code == 3);
}

TEST_CASE("simulate --augment writes logs of the same streets with other vehicles; equal seeds give equal bytes") {
  const fs::path first = scratch() / "augmented", again = scratch() / "augmented_again";
  const Outcome outcome = cloam_with(augment_words(first));
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  const auto json = nlohmann::json::parse(outcome.out);
  REQUIRE(json.at("logs").size() == 2);
  CHECK(contains(outcome.err, "simulate 6/6"));
  CHECK(contains(outcome.err, " left"));
  const Scene before = read_scene(scratch() / "two_streets" / "001");
  const Scenes few = read_scene_file(few_actors_run() / "scene.json");
  for (int log = 0; log < 2; ++log) {
    const fs::path folder = first / (log == 0 ? "001" : "002");
    const auto& told = json.at("logs").at(static_cast<std::size_t>(log));
    CHECK(told.at("folder") == folder.string());
    CHECK(told.at("vehicles") == 2);
    const Scene after = read_scene(folder);
    CHECK(after.format == "PandaSet");
    CHECK(after.night == before.night);
    CHECK(after.frames.size() == 3);
    CHECK(after.sweeps.size() == 3);
    CHECK(after.cameras.front() == before.cameras.front());
    REQUIRE(after.actors.size() == 3);
    for (const Actor& is : after.actors) {
      const Actor& was = actor_in(few[0], is.id);
      CHECK(stands_alike(is, was));
      CHECK(is.label == was.label);
      if (was.label == "Pedestrian") CHECK(is.size.isApprox(was.size, 1e-6));
    }
    // The same by hand.
    const fs::path edited = scratch() / ("augmented_by_hand" + std::to_string(log));
    const std::string car = cars()[0];
    REQUIRE(generate_into(few_actors_run(), car, edited, told.at("seed").dump()).code == 0);
    const Scenes by_hand = read_scene_file(edited / "scene.json");
    CHECK(actor_in(by_hand[0], car).size.isApprox(actor_in(after, car).size, 1e-6));
  }
  const auto files = snapshot(first);
  CHECK(files.at("001/camera/front_camera/00.jpg") != files.at("002/camera/front_camera/00.jpg"));
  REQUIRE(cloam_with(augment_words(again)).code == 0);
  CHECK(snapshot(again) == files);
  CHECK(cloam_with(augment_words(first)).code == 2);  // never among the files of others
}

TEST_CASE("a run of the same networks takes assets too") {
  const fs::path run = scratch() / "same_networks", worn = scratch() / "same_networks_worn";
  const std::string log = (scratch() / "two_streets" / "001").string();
  Words words = {"train",      "genassets", log,  "--networks", two_streets_run().string(),
                 "--steps",    "2",         "-o", run.string(), "-q",
                 "--pictures", "off"};
  const auto setting = [&](const fs::path& of, const char* name) {
    return json_of(of / "run.json").at("settings").at(name);
  };
  Outcome trained = cloam_with(words);
  REQUIRE_MESSAGE(trained.code == 0, trained.err);
  // Whether logs have masks is no property of networks.
  CHECK(setting(two_streets_run(), "weight.silhouette") == "0.01");
  CHECK(setting(run, "weight.silhouette") == "0");
  // Networks that were taken stand still, whatever a file of settings says.
  words.insert(words.end(), {"--config", (two_streets_run() / "config.toml").string(), "--overwrite"});
  trained = cloam_with(words);
  REQUIRE_MESSAGE(trained.code == 0, trained.err);
  CHECK(setting(two_streets_run(), "networks.frozen") == "false");
  CHECK(setting(run, "networks.frozen") == "true");
  words.insert(words.end(), {"--set", "networks.frozen=false"});
  trained = cloam_with(words);
  CHECK(trained.code == 2);
  CHECK(contains(trained.err, "follows from --networks alone"));
  const Outcome outcome = cloam_with({"edit", run.string(), "--actor", cars()[0] + ":replace=generated", "--prior",
                                      small_diffusion_run().string(), "-o", worn.string()});
  CHECK_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(cloam_with({"edit", worn.string(), "--list", "-o", (scratch() / "same_networks_list").string()}).code == 0);
}

TEST_CASE("what cannot be generated into a street is one error, and nothing is written") {
  const std::string id = cars()[0], prior = small_diffusion_run().string(), street = two_streets_run().string();
  const fs::path never = scratch() / "never_worn";
  const auto fails = [&](const Words& words, int code, const char* says) {
    const Outcome outcome = cloam_with(words);
    CAPTURE(outcome.err);
    CHECK(outcome.code == code);
    CHECK(contains(outcome.err, says));
    CHECK_FALSE(fs::exists(never));
  };
  // The prior that comes with the program, if one does, learned from other networks than this street's.
  const int with_shipped = fs::exists(fs::path(CLOAM_SOURCE) / "shipped" / "assets") ? 3 : 2;
  const auto edits = [&](const fs::path& run, const Words& more) {
    return edit_words(run, id + ":replace=generated", never, more);
  };
  fails(edits(street, {}), with_shipped, "cloam train diffusion");
  fails(edits(street, {"--prior", street}), 2, "cloam train diffusion");
  fails(edits(street, {"--prior", (scratch() / "nowhere").string()}), 2, "no such run folder");
  fails(edit_words(street, id + ":remove", never, {"--prior", prior}), 2, "replace=generated");
  // Another run: one number of its networks differs.
  const fs::path trained_on = copy_of(street, "trained_on");
  SafetensorsFile file = read_safetensors(trained_on / "ckpt" / "000008.safetensors");
  file.tensors.at("param.networks.field.past.bias").data[0] ^= std::byte{1};
  write_safetensors(trained_on / "ckpt" / "000008.safetensors", file);
  fails(edits(trained_on, {"--prior", prior}), 3, "whose networks are not those of");
  const fs::path odd = copy_of(street, "odd_actor");
  auto scenes = json_of(odd / "scene.json");
  for (auto& actor : scenes.at("scenes").at(0).at("actors"))
    if (actor.at("id") == id) actor["label"] = "Rolling Containers";
  write_text(odd / "scene.json", scenes.dump());
  fails(edits(odd, {"--prior", prior}), 2, "no Other was in the training set");
  const auto simulates = [&](const Words& more) {
    Words words = {"simulate", street, "-o", never.string()};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  fails(simulates({"--augment", "0", "--prior", prior}), 2, "--augment");
  fails(simulates({"--augment", "2"}), with_shipped, "cloam train diffusion");
  fails(simulates({"--prior", prior}), 2, "--prior makes the vehicles of --augment N");
  fails(simulates({"--augment", "2", "--prior", street}), 2, "cloam train diffusion");
  // A street that names an asset which its folder does not hold.
  const fs::path worn = copy_of(worn_run(), "worn_lost");
  fs::remove(worn / "generated.safetensors");
  fails({"render", worn.string(), "-o", never.string()}, 3, "uses generated asset 0");
}
