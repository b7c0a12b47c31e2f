// cloam check refuses what train would refuse, in the same words, and counts what is odd once.
#include <doctest/doctest.h>

#include "models/io/image.h"
#include "tests/cli/process.h"
#include "tests/models/errors.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// Both refuse it; returns what they say.
std::string refused(const fs::path& data) {
  const Outcome checked = cloam_with({"check", data.string()});
  const Outcome trained =
      cloam_with({"train", "splat", data.string(), "--dry-run", "-o", (scratch() / "new").string()});
  CHECK_MESSAGE(checked.code == 3, checked.out, checked.err);
  CHECK(trained.err == checked.err);
  return checked.err;
}

/// The small scene's training photos as one transforms.json.
fs::path one_list(const std::string& name, const std::string& key, const nlohmann::json& value) {
  const fs::path data = copy_of_scene(name);
  auto json = json_of(data / "transforms_train.json");
  for (auto& frame : json["frames"]) frame["file_path"] = frame["file_path"].get<std::string>() + ".png";
  json[key] = value;
  for (const char* file : {"transforms_train.json", "transforms_test.json"}) fs::remove(data / file);
  write_text(data / "transforms.json", json.dump());
  return data;
}

}  // namespace

TEST_CASE("check refuses masks of 0 and 1, and a split that leaves no photo, as train does") {
  const fs::path masked = copy_of_scene("check-masks");
  for (const auto& photo : fs::directory_iterator(masked / "train")) {
    fs::create_directories(masked / "masks/train");
    write_png(masked / "masks/train" / photo.path().filename(), {24, 24, 1, std::vector<std::uint8_t>(24 * 24, 1)});
  }
  CHECK(holds(refused(masked), "is 1, want 255 where the photo counts"));
  nlohmann::json names;
  for (int i = 0; i < 8; ++i) names.push_back("train/r_" + std::to_string(i) + ".png");
  const std::string none = refused(one_list("check-split", "test_filenames", names));
  CHECK(holds(none, "no images are left to train on: of 8 images 8 are held out"));
  CHECK(holds(none, "--holdout 8"));
}

TEST_CASE("check: photos smaller than listed are one remark, and what is shown is their own size") {
  const fs::path data = one_list("check-size", "w", 48);
  auto json = json_of(data / "transforms.json");
  json["h"] = 48;
  write_text(data / "transforms.json", json.dump());
  const Outcome checked = cloam_with({"check", data.string()});
  CHECK_MESSAGE(checked.code == 0, checked.err);
  CHECK(holds(checked.out, "8 images 24x24"));
  CHECK(holds(checked.err, "8 images (train/r_0.png: 24x24 pixels, listed as 48x48, ...) do not have the size"));
  CHECK_FALSE(holds(checked.err, "more images like it"));
}

TEST_CASE("check warns of depth maps without a depth") {
  const fs::path data = one_list("check-depths", "depth_unit_scale_factor", 0.001);
  auto json = json_of(data / "transforms.json");
  for (auto& frame : json["frames"]) frame["depth_file_path"] = "depth.png";
  write_text(data / "transforms.json", json.dump());
  write_png(data / "depth.png", {24, 24, 1, std::vector<std::uint8_t>(24 * 24)});
  const Outcome checked = cloam_with({"check", data.string()});
  CHECK(checked.code == 0);
  CHECK_MESSAGE(holds(checked.err, "no pixel of the depth maps has a depth: nothing is learned from them"),
                checked.err);
}
