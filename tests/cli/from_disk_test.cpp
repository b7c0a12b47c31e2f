// Images that are read while a training goes on.
#include <doctest/doctest.h>

#include <algorithm>

#include "tests/cli/mpirun.h"
#include "tests/cli/small_street.h"
#include "tests/cli/small_trainings.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

/// genassets on small_street(): ten steps, whose images are of 5184 bytes each.
Words small_genassets(const std::string& run, const Words& more) {
  Words words = small_trainings()[2].words(scratch() / run, {"--steps", "10", "--save-every", "5"});
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

std::string trained_bytes(const std::string& run, const Words& more, const Words& environment = {}) {
  const Outcome outcome = cloam_with(small_genassets(run, more), environment);
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  return content_of(scratch() / run / "ckpt" / "000010.safetensors");
}

}  // namespace

TEST_CASE("a training from disk gives the bytes of one from memory, also where every step decodes anew") {
  for (const Words& how : {Words{}, Words{"--set", "batch.whole_images=true"}}) {
    const std::string name = how.empty() ? "patches" : "whole";
    const auto with = [&](const std::string& memory) {
      Words words = how;
      words.insert(words.end(), {"--host-memory", memory});
      return trained_bytes(name + memory, words);
    };
    const std::string all = trained_bytes(name, how);
    CHECK(with("1K") == all);  // none is held
    CHECK(with("6K") == all);  // one is: what is decoded ahead takes its place
    CHECK(with("1M") == all);
  }
}

TEST_CASE("a training of several logs gives the bytes of one from memory, also where every scene is unpacked anew") {
  const Words twins = {copy_of(small_street(), "twin-a").string(), copy_of(small_street(), "twin-b").string()};
  const auto with = [&](const std::string& run, const Words& more) {
    Words words = small_genassets(run, more);
    words.insert(std::find(words.begin(), words.end(), small_street().string()), twins.begin(), twins.end());
    const Outcome outcome = cloam_with(words);
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    return content_of(scratch() / run / "ckpt" / "000010.safetensors");
  };
  const std::string all = with("several_from_memory", {});
  CHECK(with("several-few", {"--host-memory", "1K"}) == all);
  CHECK(with("several-some", {"--host-memory", "40K"}) == all);
}

TEST_CASE("a training from kept sweeps gives the bytes of one that reads the log") {
  const std::string read = trained_bytes("read", {}, {"CLOAM_DATA_CACHE=off"});
  const fs::path folder = scratch() / "kept-sweeps";
  const Words kept = {"CLOAM_DATA_CACHE=" + folder.string()};
  CHECK(trained_bytes("cold", {}, kept) == read);
  CHECK(snapshot(folder).size() == 4);  // three sweeps and the voxels
  const auto entries = snapshot(folder);
  CHECK(trained_bytes("warm", {"--host-memory", "1K"}, kept) == read);
  CHECK(snapshot(folder) == entries);
  const Outcome doctor = cloam_with({"doctor"}, kept);
  CHECK_MESSAGE(contains(doctor.out, "kept sweeps: " + folder.string() + ", "), doctor.out);
  CHECK_MESSAGE(contains(doctor.out, " in 4 files"), doctor.out);
  CHECK(contains(cloam_with({"doctor"}, {"CLOAM_DATA_CACHE=off"}).out, "none are kept"));
}

TEST_CASE("the plan tells host and device memory apart, and the record keeps both") {
  const Outcome outcome = cloam_with(small_genassets("planned", {"--host-memory", "6K"}));
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "decoded ahead of use"), outcome.err);
  const std::string events = content_of(scratch() / "planned" / "metrics.jsonl");
  const nlohmann::json plan = nlohmann::json::parse(events.substr(0, events.find('\n')));
  CHECK(plan["image_bytes"] == 3 * 48 * 27 * 4);
  CHECK(plan["host_bytes"] == 6 << 10);
  const nlohmann::json memory = json_of(scratch() / "planned" / "run.json")["memory"];
  CHECK(memory["host_budget_bytes"] == 6 << 10);
  CHECK(memory["device_bytes"] == plan["memory_bytes"]);
  const Outcome roomy = cloam_with({"train", "genassets", small_street().string(), "--preset", "genassets-small",
                                    "--dry-run", "--host-memory", "1G", "-o", (scratch() / "roomy").string()});
  CHECK_MESSAGE(contains(roomy.err, "of 1.0 GB (images 0.0 MB, all of them held)"), roomy.err);
}

TEST_CASE("an image that is damaged in the middle ends the training with what it learned until then") {
  const std::string sound = trained_bytes("sound", {});
  int saved = 0;
  for (const std::string image : {"00", "01", "02"}) {
    CAPTURE(image);
    const fs::path log = copy_of(small_street(), "damaged" + image), run = scratch() / ("run" + image),
                   photo = log / "camera" / "front_camera" / (image + ".jpg");
    Words words = small_genassets("run" + image, {"--host-memory", "1K"});
    std::replace(words.begin(), words.end(), small_street().string(), log.string());
    const std::string bytes = content_of(photo);
    std::string damaged = bytes;
    damaged.replace(bytes.size() - 100, 4, "\xff\xe1\xff\xff");  // a segment that is longer than the file
    write_text(photo, damaged);
    const Outcome outcome = cloam_with(words);
    if (!fs::exists(run)) continue;  // of the first image, the reader looks at more
    REQUIRE_MESSAGE(outcome.code == 3, outcome.err);
    CHECK_MESSAGE(contains(outcome.err, image + ".jpg: "), outcome.err);
    CHECK(json_of(run / "run.json")["state"] == "failed");
    if (contains(outcome.err, "no checkpoint was saved yet")) continue;  // the first step asked for it
    ++saved;
    CHECK_MESSAGE(contains(outcome.err, " is whole; "), outcome.err);
    write_text(photo, bytes);
    const Outcome resumed = cloam_with({"train", "--resume", run.string(), "--pictures", "off"});
    REQUIRE_MESSAGE(resumed.code == 0, resumed.err);
    CHECK(content_of(run / "ckpt" / "000010.safetensors") == sound);
  }
  CHECK(saved > 0);
}

TEST_CASE("what one of two ranks finds damaged ends both, with what they learned until then") {
  const auto words_for = [](const fs::path& where, const std::string& name) {
    Words words = small_genassets(name, {"--host-memory", "1K", "--set", "batch.patches=2"});
    std::replace(words.begin(), words.end(), small_street().string(), where.string());
    return words;
  };
  const fs::path sound = scratch() / "sound_for_ranks";
  REQUIRE(Ranks(2, words_for(small_street(), "sound_for_ranks")).wait().code == 0);
  bool saved = false;
  for (const std::string image : {"01", "02", "00"}) {
    if (saved) continue;
    CAPTURE(image);
    const std::string name = "damaged_for_a_rank" + image;
    const fs::path log = copy_of(small_street(), "log_" + name),
                   photo = log / "camera" / "front_camera" / (image + ".jpg");
    const std::string bytes = content_of(photo);
    std::string damaged = bytes;
    damaged.replace(bytes.size() - 100, 4, "\xff\xe1\xff\xff");
    write_text(photo, damaged);
    const Outcome outcome = Ranks(2, words_for(log, name)).wait();
    CHECK_MESSAGE(outcome.code == 3, outcome.err);
    CHECK_MESSAGE(contains(outcome.err, image + ".jpg: "), outcome.err);
    CHECK_MESSAGE(outcome.err.find("error: ") == outcome.err.rfind("error: "), outcome.err);
    if (contains(outcome.err, "no checkpoint was saved yet")) continue;  // the first step asked for it
    saved = true;
    REQUIRE_MESSAGE(contains(outcome.err, " is whole; "), outcome.err);
    write_text(photo, bytes);
    const Outcome resumed = Ranks(2, {"train", "--resume", (scratch() / name).string(), "--pictures", "off"}).wait();
    REQUIRE_MESSAGE(resumed.code == 0, resumed.err);
    CHECK(content_of(scratch() / name / "ckpt" / "000010.safetensors") ==
          content_of(sound / "ckpt" / "000010.safetensors"));
  }
  CHECK(saved);
}

}  // namespace cloam
