// cloam crops: what it writes and prints, and what it says of logs and masks that it cannot take.
#include <doctest/doctest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "models/io/commit.h"
#include "models/io/image.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// A street whose actors have a hundred pixels.
const fs::path& street() {
  static const fs::path log = [] {
    const fs::path logs = scratch() / "crop-streets";
    const Outcome made = cloam_with({"synth", "-o", logs.string(), "--logs", "1", "--frames", "3", "--size", "160x90",
                                     "--cameras", "front", "--beams", "24", "-q"});
    REQUIRE_MESSAGE(made.code == 0, made.err);
    return logs / "001";
  }();
  return log;
}

Outcome crops(const fs::path& log, const fs::path& out, const Words& more = {}) {
  Words words = {"crops", log.string(), "-o", out.string(), "--size", "32"};
  words.insert(words.end(), more.begin(), more.end());
  return cloam_with(words);
}

/// The exit code and a part of the one message; nothing is written.
void check_refused(const Outcome& outcome, int code, const std::string& part, const fs::path& out) {
  CHECK_MESSAGE(outcome.code == code, outcome.err);
  CHECK_MESSAGE(contains(outcome.err, part), outcome.err);
  CHECK_FALSE(fs::exists(out));
}

}  // namespace

TEST_CASE("crops of a log: pictures and an index, the same counts in words and as JSON") {
  const fs::path out = scratch() / "crops";
  const Outcome made = crops(street(), out, {"--json"});
  REQUIRE_MESSAGE(made.code == 0, made.err);
  const auto report = nlohmann::json::parse(made.out), index = json_of(out / "crops.json");
  CHECK(report["folder"] == out.string());
  CHECK(report["images"] == 3);
  CHECK(report["images_with_mask_file"] == 3);
  CHECK(report["kept"].get<std::size_t>() > 0);
  CHECK(report["kept"] == index["crops"].size());
  CHECK(report["objects"].get<int>() == report["kept"].get<int>() + report["rejected_lidar_outside"].get<int>() +
                                            report["rejected_few_pixels"].get<int>() +
                                            report["rejected_covered"].get<int>());
  int of_classes = 0;
  for (const auto& [name, counts] : report["classes"].items()) of_classes += counts["kept"].get<int>();
  CHECK(report["kept"] == of_classes);
  std::set<std::string> files;
  for (const auto& crop : index["crops"]) {
    files.insert(crop["file"].get<std::string>());
    CHECK(read_image_size(out / crop["file"].get<std::string>()).width == 32);
  }
  CHECK(files.size() == index["crops"].size());
  const Outcome told = crops(street(), scratch() / "crops-told");
  CHECK(contains(told.out, "class  "));
  CHECK(contains(told.out, "\nall  "));
  CHECK(contains(told.out, "3 images, 3 with masks from files"));
  CHECK(contains(told.err, "3/3 images"));
  const Outcome training = crops(street(), scratch() / "crops-training", {"--training"});
  CHECK(contains(training.out, "50 % covered by nearer boxes"));
  const Outcome again = crops(street(), out);
  CHECK(again.code == 2);
  CHECK(contains(again.err, out.string() + " exists; name a new folder with -o"));
}

TEST_CASE("captures that are no logs, have no actors or no images of the split: one error, nothing written") {
  const fs::path out = scratch() / "no-crops";
  check_refused(crops(small_scene(), out), 2, "holds photos, not a driving log", out);
  check_refused(crops(scratch() / "nowhere", out), 3, "no such folder", out);
  fs::create_directories(scratch() / "bare");
  check_refused(crops(scratch() / "bare", out), 3, "holds no capture that can be read", out);
  check_refused(crops(street(), out, {"--split", "test"}), 2, "choose one with --protocol or --holdout", out);
  check_refused(crops(street(), out, {"--protocol", "sparse", "--holdout", "2"}), 2, "give only one", out);
  check_refused(cloam_with({"crops", street().string(), street().string(), "-o", out.string()}), 2,
                "are both called crop-streets-001", out);
  const fs::path empty = copy_of(street(), "log-without-actors");
  fs::remove_all(empty / "annotations");
  check_refused(crops(empty, out), 3, "has no actor with a box", out);
  const Outcome split = crops(street(), scratch() / "held-out-crops", {"--split", "test", "--holdout", "2"});
  CHECK_MESSAGE(split.code == 0, split.err);
  CHECK(contains(split.out, "2 images, "));
}

TEST_CASE("masks of a wrong size or kind are named; with --skip-bad their images are left out") {
  const fs::path masks = copy_of(street() / "truth", "masks"), out = scratch() / "masked-crops";
  const Words brought = {"--masks", masks.string()};
  const fs::path second = masks / "front_camera/01_actor.png";
  write_png(second, {80, 44, 1, std::vector<std::uint8_t>(80 * 44)});
  const Outcome size = crops(street(), out, brought);
  CHECK(size.code == 3);
  CHECK_MESSAGE(contains(size.err, second.string() + ": the mask has 80x44 pixels, the image as loaded 160x90"),
                size.err);
  CHECK_FALSE(fs::exists(out / "crops.json"));
  fs::remove_all(out);
  const Outcome skipped = crops(street(), out, {"--masks", masks.string(), "--skip-bad"});
  CHECK_MESSAGE(skipped.code == 0, skipped.err);
  CHECK(contains(skipped.err, "warning: image left out: " + second.string()));
  CHECK(contains(skipped.out, "2 images, 2 with masks from files"));
  write_text(second, "no image");
  fs::remove_all(out);
  CHECK(crops(street(), out, brought).code == 3);
  fs::remove(masks / "actors.json");
  fs::remove_all(out);
  check_refused(crops(street(), out, brought), 3, "found no " + (masks / "001/actors.json").string(), out);
  write_text(masks / "actors.json", "[]");
  check_refused(crops(street(), out, brought), 3, "want an object of instance numbers", out);
}

TEST_CASE("crops of logs of one name are told apart by the folders that they lie in") {
  const fs::path other = scratch() / "crops-of-another-place" / street().filename(),
                 out = scratch() / "crops-of-one-name";
  fs::create_directories(other.parent_path());
  fs::copy(street(), other, fs::copy_options::recursive);
  const Outcome made = cloam_with({"crops", street().string(), other.string(), "-o", out.string(), "--json", "-q"});
  REQUIRE_MESSAGE(made.code == 0, made.err);
  const auto index = json_of(out / "crops.json");
  std::set<std::string> names;
  for (const auto& log : index.at("logs")) names.insert(log.at("name"));
  CHECK(names == std::set<std::string>{"crop-streets-001", "crops-of-another-place-001"});
}
