// The demo, as small as it can be: its page holds what its parts found, and nothing but itself.
#include <doctest/doctest.h>
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <regex>

#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

Words small_demo(const fs::path& out) {
  Words words = {"demo", "-o",       out.string(), "--size",   "48x27", "--logs",
                 "2",    "--frames", "2",          "--assets", "3",     "--json"};
  words.insert(words.end(), {"--steps", "8", "--networks", "none"});
  for (const char* setting : {"background.side=32", "batch.patches=2", "batch.patch_side=8", "batch.lidar_rays=32",
                              "code.side=4", "code.channels=4", "decoder.middle=16", "decoder.widths=16,8,8",
                              "decoder.groups=4", "weight.perceptual=0", "field.sharpness=1"})
    words.insert(words.end(), {"--set", setting});
  return words;
}

/// Everything that an attribute makes a reader fetch.
std::vector<std::string> references(const std::string& html) {
  const std::regex attribute("(src|href|url)\\s*[=(]\\s*[\"']?([^\"'> )]{1,24})");
  std::vector<std::string> found;
  for (std::sregex_iterator match(html.begin(), html.end(), attribute), end; match != end; ++match)
    found.push_back((*match)[2]);
  return found;
}

double distance_between(const fs::path& a, const fs::path& b) {
  const Outcome outcome =
      cloam_with({"distance", (a / "pictures").string(), (b / "pictures").string(), "--features", "random", "--json"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  return nlohmann::json::parse(outcome.out).at("frechet_feature_distance");
}

}  // namespace

TEST_CASE("a demo ends with one page that holds its figures and pictures") {
  const fs::path out = scratch() / "demo";
  const Outcome outcome = cloam_with(small_demo(out));
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  const std::string html = content_of(out / "index.html");
  CHECK(contains(outcome.err, (out / "index.html").string()));
  const auto told = nlohmann::json::parse(outcome.out);  // one object and nothing else
  CHECK(told.at("page") == (out / "index.html").string());
  // How long trainings of so many steps take is not known before they ran.
  const std::size_t generating = outcome.err.find("[5/7]");
  REQUIRE(generating != std::string::npos);
  CHECK_FALSE(contains(outcome.err.substr(0, generating), "left in total"));
  CHECK(contains(outcome.err.substr(generating, outcome.err.find('\n', generating) - generating), "left in total"));

  const auto street = json_of(out / "street" / "eval" / "eval.json"), prior = json_of(out / "prior/eval/eval.json");
  for (const char* key : {"psnr", "baseline_blend_psnr", "masked_psnr"})
    CHECK_MESSAGE(contains(html, fmt::format("{:.2f} dB", street.at(key).get<double>())), key);
  for (const char* key : {"v_loss", "wiener_v_loss", "baseline_zero_v_loss"})
    CHECK_MESSAGE(contains(html, fmt::format("{:.3f}", prior.at(key).get<double>())), key);
  const double samples = distance_between(out / "samples", out / "training"),
               gaussian = distance_between(out / "gaussian", out / "training"),
               random = distance_between(out / "random", out / "training");
  CHECK(contains(html, fmt::format("<b>{:.4g}</b>", samples)));
  CHECK(contains(html, fmt::format("{:.4g} (codes drawn from a Gaussian of each class), {:.4g} (random latents)",
                                   gaussian, random)));
  CHECK(contains(html, fmt::format("half as far as random latents; got {:+.0f} %", 100 * (samples / random - 1))));

  const std::vector<std::string> fetched = references(html);
  CHECK(fetched.size() > 10);
  for (const std::string& one : fetched) CHECK(one.starts_with("data:image/"));
  CHECK_FALSE(contains(html, "<script"));
  CHECK_FALSE(contains(html, "<link"));
  CHECK(contains(html, ">before<"));
  CHECK(contains(html, "New vehicles, from all sides"));
  CHECK(fs::exists(out / "first" / "Car" / "asset_001.gif"));
  CHECK(told.at("swapped").at("actors").size() > 0);

  // The commands are those that were run: one of them makes the same again.
  std::string edit;
  for (const auto& command : told.at("commands")) {
    const std::string line = command.at("command");
    if (contains(line, "cloam edit ")) edit = line;
  }
  CHECK(contains(edit, ":replace=generated"));
  CHECK(contains(json_of(out / "edited" / "run.json").at("command_line"), edit));
  CHECK(json_of(out / "street" / "run.json").at("data").size() == 2);
}

TEST_CASE("a demo leaves alone what is no demo") {
  const fs::path out = scratch() / "no_demo";
  fs::create_directories(out / "logs");
  write_text(out / "logs" / "mine.txt", "mine");
  const auto before = snapshot(out);
  const Outcome outcome = cloam_with(small_demo(out));
  CHECK(outcome.code == 2);
  CHECK(contains(outcome.err, "not a demo"));
  CHECK(snapshot(out) == before);
}
