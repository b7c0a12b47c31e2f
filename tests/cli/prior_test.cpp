// Priors that are handed on: packed small, and used as the runs that they were made from.
#include <doctest/doctest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "models/io/image.h"
#include "models/io/paths.h"
#include "models/latents/new_assets.h"
#include "models/metrics/psnr.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

const fs::path& packed() {
  static const fs::path folder = [] {
    fs::path out = scratch() / "packed";
    const Outcome outcome =
        cloam_with({"export", small_diffusion_run().string(), "--format", "prior", "-o", out.string()});
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    return out;
  }();
  return folder;
}

std::uintmax_t bytes_in(const fs::path& folder) {
  std::uintmax_t bytes = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file()) bytes += entry.file_size();
  return bytes;
}

fs::path generated(const fs::path& prior, const std::string& name) {
  fs::path out = scratch() / name;
  const Outcome outcome =
      cloam_with({"generate", prior.string(), "-o", out.string(), "-n", "3", "--steps", "4", "--frames", "2", "--size",
                  "32", "--pictures", "--no-meshes", "--seed", "3", "-q"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  return out;
}

}  // namespace

TEST_CASE("a packed prior generates what the runs that it was made from do, up to its rounding") {
  const fs::path whole = generated(small_diffusion_run(), "of_whole"),
                 small = generated(packed() / "assets", "of_packed");
  const NewAssets a = read_new_assets(whole / "latents.safetensors"),
                  b = read_new_assets(small / "latents.safetensors");
  REQUIRE(a.assets.size() == b.assets.size());
  for (std::size_t i = 0; i < a.assets.size(); ++i) {
    CHECK(a.assets[i].asset_class == b.assets[i].asset_class);
    CHECK(a.assets[i].night == b.assets[i].night);
    CHECK(a.assets[i].size.isApprox(b.assets[i].size, 1e-6));
    double apart = 0, all = 0;
    for (std::size_t k = 0; k < a.assets[i].code.size(); ++k) {
      apart += std::pow(a.assets[i].code[k] - b.assets[i].code[k], 2);
      all += std::pow(a.assets[i].code[k], 2);
    }
    CHECK(std::sqrt(apart / all) < 5e-3);
  }
  for (const fs::path& file : entries_of(whole / "pictures")) {
    const Image one = read_image(file), other = read_image(small / "pictures" / file.filename());
    std::vector<float> x, y;
    for (const auto byte : one.pixels) x.push_back(static_cast<float>(byte) / 255);
    for (const auto byte : other.pixels) y.push_back(static_cast<float>(byte) / 255);
    CHECK(psnr(x, y) > 35);
  }
}

TEST_CASE("a packed prior is small, and holds neither images, trajectories nor where it was trained") {
  CHECK(bytes_in(packed()) * 4 < bytes_in(two_streets_run()) + bytes_in(small_diffusion_run()));
  for (const char* kind : {"networks", "assets"}) {
    const auto record = json_of(packed() / kind / "run.json");
    CHECK_FALSE(contains(record.dump(), scratch().string()));
    const auto scenes = json_of(packed() / kind / "scene.json");
    CHECK(scenes.at("scenes").size() == 2);
    for (const auto& scene : scenes.at("scenes")) {
      CHECK(scene.at("sweeps").empty());
      for (const auto& actor : scene.at("actors")) CHECK(actor.at("boxes") == 0);
    }
  }
  const Outcome again =
      cloam_with({"export", small_diffusion_run().string(), "--format", "prior", "-o", packed().string()});
  CHECK(again.code == 2);
  CHECK(contains(again.err, "is not empty"));
  const Outcome street = cloam_with({"export", two_streets_run().string(), "--format", "prior", "-o", "never"});
  CHECK(street.code == 2);
  CHECK(contains(street.err, "cloam train diffusion"));
}

TEST_CASE("a new log is fitted with packed networks and prior, and its vehicles are exchanged by them") {
  const fs::path run = scratch() / "with_packed", logs = scratch() / "packed_logs";
  const Outcome trained =
      cloam_with({"train", "genassets", small_street().string(), "--networks", (packed() / "networks").string(),
                  "--prior", (packed() / "assets").string(), "--steps", "3", "-o", run.string(), "--pictures", "off"});
  REQUIRE_MESSAGE(trained.code == 0, trained.err);
  const Outcome augmented = cloam_with({"simulate", run.string(), "--augment", "1", "--prior",
                                        (packed() / "assets").string(), "--size", "32x18", "-o", logs.string()});
  CHECK_MESSAGE(augmented.code == 0, augmented.err);
  const Outcome other = cloam_with({"simulate", small_street_run().string(), "--augment", "1", "--prior",
                                    (packed() / "assets").string(), "-o", (scratch() / "never").string()});
  CHECK(other.code == 3);
  CHECK(contains(other.err, "cloam train diffusion"));
}
