// A diffusion's samples against photographs of actors, through the program.
#include <doctest/doctest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// Photographs of the actors of four streets.
const fs::path& crops_of_streets() {
  static const fs::path crops = [] {
    const fs::path logs = scratch() / "photographed", out = scratch() / "photographed_crops";
    REQUIRE(cloam_with({"synth", "-o", logs.string(), "--logs", "4", "--frames", "6", "--size", "160x90", "--cameras",
                        "front", "--beams", "8", "--night", "0.5", "--seed", "2", "-q"})
                .code == 0);
    Words words = {"crops", "-o", out.string(), "--size", "24", "-q"};
    for (const char* log : {"001", "002", "003", "004"}) words.push_back((logs / log).string());
    const Outcome cut = cloam_with(words);
    REQUIRE_MESSAGE(cut.code == 0, cut.err);
    return out;
  }();
  return crops;
}

}  // namespace

TEST_CASE("eval of a run of diffusion with photos holds samples, Gaussians and training assets against the same ones") {
  const Words words = {"eval",     small_diffusion_run().string(), "--json", "--features", "random",
                       "--photos", crops_of_streets().string()};
  const Outcome evaluated = cloam_with(words);
  REQUIRE_MESSAGE(evaluated.code == 0, evaluated.err);
  CHECK(contains(evaluated.err, " assets  left 0s"));  // as many were shown as it said there would be
  const auto json = nlohmann::json::parse(evaluated.out);
  CHECK(json.at("schema_version") == 2);
  for (const std::string kind : {"", "baseline_gaussian_", "baseline_random_", "baseline_training_"})
    for (const std::string distance : {"frechet_feature_distance", "kernel_feature_distance"})
      CHECK_MESSAGE(std::isfinite(json.at("photos_" + kind + distance).get<double>()), (kind + distance));
  const double samples = json.at("photos_frechet_feature_distance"),
               gaussians = json.at("photos_baseline_gaussian_frechet_feature_distance"),
               training = json.at("photos_baseline_training_frechet_feature_distance");
  if (gaussians > training)
    CHECK(json.at("photos_frechet_ratio").get<double>() ==
          doctest::Approx((samples - training) / (gaussians - training)));
  else
    CHECK(json.at("photos_frechet_ratio").is_null());
  CHECK(json.at("photos").get<int>() > 20);
  CHECK(json.at("photos_assets").get<int>() > 3);
  CHECK(json.at("classes").size() >= 2);
  CHECK(json.at("class_logs_held_out").size() == 1);
  for (const char* key : {"class_right_photos_held_out", "class_right_photos_held_out_plain", "class_right_pictures",
                          "class_right_pictures_of_training", "class_right_box", "class_right_box_of_training",
                          "class_right_box_photos_held_out", "baseline_class_right"}) {
    CHECK_MESSAGE((json.at(key) >= 0 && json.at(key) <= 1), key);
  }
  for (const std::string of : {"pictures", "pictures_of_training", "photos_held_out"}) {
    CAPTURE(of);
    const auto& named = json.at("class_named_" + of);
    double right = 0;
    for (const auto& [truth, shares] : named.items())
      right += shares.value(truth, 0.) / static_cast<double>(named.size());
    CHECK(right == doctest::Approx(json.at("class_right_" + of).get<double>()));
  }
  CHECK(json.at("wiener_v_loss") > 0);
  double weights = 0;
  for (const auto& weight : json.at("gaussian_weights")) weights += weight.get<double>();
  CHECK(weights == doctest::Approx(1));
  CHECK_FALSE(json.contains("photos_files"));
  CHECK(json_of(small_diffusion_run() / "eval" / "eval.json").at("photos_files").size() == json.at("photos"));
  const auto kept = [] {
    auto file = json_of(small_diffusion_run() / "eval" / "eval.json");
    file.erase("seconds");
    return file;
  };
  const auto first = kept();
  const Outcome table = cloam_with(
      {"eval", small_diffusion_run().string(), "--features", "random", "--photos", crops_of_streets().string()});
  CHECK(contains(table.out, "distance to photos, Frechet"));
  CHECK(kept() == first);
}

TEST_CASE("photos without features, of no crops and for other runs are one error") {
  const auto fails = [](const Words& words, int code, const char* says) {
    const Outcome outcome = cloam_with(words);
    CHECK(outcome.code == code);
    CHECK_MESSAGE(contains(outcome.err, says), outcome.err);
  };
  const std::string run = small_diffusion_run().string();
  fails({"eval", run, "--photos", small_street().string()}, 2, "--photos also needs --features");
  fails({"eval", run, "--photos", small_street().string(), "--features", "random"}, 3, "found no crops.json");
  fails({"eval", small_street_run().string(), "--photos", small_street().string()}, 2,
        "--photos is for diffusion runs");
}
