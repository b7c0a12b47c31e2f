// Streets through the program with the model itself: measured, listed, exported, compared.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <set>

#include "models/io/image.h"
#include "models/runs/run_folder.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

std::uint32_t word_at(const std::string& bytes, std::size_t at) {
  std::uint32_t value = 0;
  REQUIRE(at + 4 <= bytes.size());
  std::memcpy(&value, bytes.data() + at, 4);
  return value;
}

/// The JSON of a binary glTF 2.0 whose lengths fit its bytes.
nlohmann::json json_of_glb(const fs::path& path) {
  const std::string bytes = content_of(path);
  REQUIRE(bytes.substr(0, 4) == "glTF");
  CHECK(word_at(bytes, 4) == 2);
  CHECK(word_at(bytes, 8) == bytes.size());
  const std::size_t length = word_at(bytes, 12);
  CHECK(bytes.substr(16, 4) == "JSON");
  const auto json = nlohmann::json::parse(bytes.substr(20, length));
  CHECK(word_at(bytes, 20 + length) == bytes.size() - 28 - length);
  CHECK(json.at("buffers").at(0).at("byteLength") == bytes.size() - 28 - length);
  return json;
}

std::string first_actor() {
  return json_of(RunPaths{small_street_run()}.scene()).at("scenes").at(0).at("actors").at(0).at("id");
}

/// A run as far as compare reads it: its record, and what an evaluation left.
std::string measured_run(const std::string& name, const RunRecord& record, const nlohmann::json& eval) {
  const RunPaths run{scratch() / name};
  write_record(run.root, record);
  fs::create_directories(run.eval());
  nlohmann::json whole = eval;
  whole["schema_version"] = 2;
  write_text(run.eval() / "eval.json", whole.dump());
  return run.root.string();
}

RunRecord record_with_seed(std::uint64_t seed) {
  RunRecord record;
  record.state = "finished";
  record.method = record.preset = "genassets";
  record.seed = seed;
  record.step = 70;
  record.data = {{"logs/001", "../logs/001", "x"}};
  return record;
}

}  // namespace

TEST_CASE("eval of a street gives a figure over actors by true masks, and an error of the LiDAR") {
  const Outcome evaluated = cloam_with({"eval", small_street_run().string(), "--json"});
  REQUIRE_MESSAGE(evaluated.code == 0, evaluated.err);
  const auto json = nlohmann::json::parse(evaluated.out);
  CHECK(json.at("protocol") == "holdout-3");
  CHECK(json.at("images") == 1);
  CHECK(json.at("masks") == "truth");
  CHECK(json.at("preset") == "genassets-small");
  CHECK(json.at("lidar_median_error_m") > 0);
  CHECK(json.at("lidar_chamfer_m2") > 0);
  for (const char* key :
       {"psnr", "masked_psnr", "baseline_blend_psnr", "baseline_blend_masked_psnr", "baseline_mean_masked_psnr"}) {
    CAPTURE(key);
    CHECK(json.at(key) > 3);
    CHECK(json.at(key) < 40);
  }
  CHECK(json.at("masked_psnr") != json.at("psnr"));
  const Outcome smaller = cloam_with({"eval", small_street_run().string(), "--json", "--downscale", "2"});
  REQUIRE_MESSAGE(smaller.code == 0, smaller.err);
  const auto half = nlohmann::json::parse(smaller.out);
  CHECK(half.at("downscale") == 2);
  CHECK(half.at("lidar_median_error_m") == json.at("lidar_median_error_m"));
  for (const char* key : {"psnr", "masked_psnr"})
    CHECK(half.at(key).get<double>() == doctest::Approx(json.at(key).get<double>()).epsilon(0.3));
}

TEST_CASE("edit --list draws the actors that the model shows") {
  const fs::path folder = scratch() / "listed";
  const Outcome listed = cloam_with({"edit", small_street_run().string(), "--list", "-o", folder.string(), "--json"});
  REQUIRE_MESSAGE(listed.code == 0, listed.err);
  const auto json = nlohmann::json::parse(listed.out);
  const auto scene = json_of(RunPaths{small_street_run()}.scene()).at("scenes").at(0);
  CHECK(json.at("actors").size() == scene.at("actors").size());
  CHECK(json.at("actors").at(0).at("actor") == first_actor());
  const Image sheet = read_image(json.at("thumbnails").get<std::string>());
  constexpr int kSide = 128, kGap = 4, kColumns = 8;
  const int actors = static_cast<int>(json.at("actors").size()), rows = (actors + kColumns - 1) / kColumns;
  CHECK(sheet.width == kColumns * (kSide + kGap) - kGap);
  const int cell = (sheet.height + kGap) / rows, strip = cell - kGap - kSide;
  REQUIRE(strip > 20);
  std::set<std::string> captions;  // number, beginning of the id and label: no two are alike
  for (int i = 0; i < actors; ++i) {
    std::string caption;
    for (int row = 0; row < strip; ++row) {
      const int top = i / kColumns * cell + kSide + row, left = i % kColumns * (kSide + kGap);
      const auto* from = &sheet.pixels[(std::size_t(top) * sheet.width + left) * 3];
      caption.append(from, from + 3 * kSide);
    }
    CHECK(std::count(caption.begin(), caption.end(), '\xff') < std::ssize(caption));
    captions.insert(caption);
    CHECK(json.at("actors").at(static_cast<std::size_t>(i)).at("number") == i + 1);
  }
  CHECK(captions.size() == json.at("actors").size());
  const std::string last = json.at("actors").back().at("short_id");
  const fs::path edited = scratch() / "edited_by_short_id";
  CHECK(cloam_with({"edit", small_street_run().string(), "--actor", last + ":remove", "-o", edited.string()}).code ==
        0);
  CHECK(json_of(RunPaths{edited}.scene()).at("scenes").at(0).at("actors").back().at("boxes") == 0);
}

TEST_CASE("export writes a mesh that glTF readers take, or tells that there is no surface; and a turntable") {
  const std::string run = small_street_run().string(), actor = first_actor();
  const fs::path mesh = scratch() / "actor.glb", turntable = scratch() / "turn";
  const Outcome meshed =
      cloam_with({"export", run, "--format", "glb", "--actor", actor, "-o", mesh.string(), "--resolution", "16"});
  if (meshed.code == 0) {
    const auto json = json_of_glb(mesh);
    CHECK(json.at("asset").at("version") == "2.0");
    CHECK(json.at("meshes").at(0).at("primitives").at(0).at("attributes").contains("COLOR_0"));
  } else {  // what one step makes of an actor need not have a surface
    CHECK(meshed.code == 3);
    CHECK_MESSAGE(meshed.err.find("has no surface in its box") != std::string::npos, meshed.err);
    CHECK_FALSE(fs::exists(mesh));
  }
  const Outcome turned = cloam_with({"export", run, "--format", "turntable", "--actor", actor, "-o", turntable.string(),
                                     "--frames", "3", "--size", "16"});
  REQUIRE_MESSAGE(turned.code == 0, turned.err);
  CHECK(read_image_size(turntable / "turn_0002.png").width == 16);
  CHECK_FALSE(fs::exists(turntable / "turn_0003.png"));
  CHECK(content_of(turntable / "turntable.gif").substr(0, 3) == "GIF");
  const std::string never = (scratch() / "never").string();
  const Outcome around = cloam_with({"export", run, "--background", "-o", never + ".obj", "--resolution", "32"});
  CHECK_MESSAGE((around.code == 0 ? content_of(never + ".obj").find("\nf ") != std::string::npos
                                  : around.err.find("has no surface") != std::string::npos),
                around.err);
  CHECK(cloam_with({"export", run, "--background", "--actor", actor, "-o", never}).code == 2);
  CHECK(cloam_with({"export", run, "--format", "gbl", "-o", never}).err.find("did you mean glb?") != std::string::npos);
  CHECK(cloam_with({"export", run, "--actor", "nobody", "-o", never}).code == 2);
  CHECK(cloam_with({"export", small_street().string(), "-o", never}).code == 3);  // a log is no run
  CHECK_FALSE(fs::exists(never));
}

TEST_CASE("compare puts runs side by side and averages over seeds alone") {
  const nlohmann::json figures = {{"protocol", "sparse"}, {"step", 70}, {"psnr", 20}, {"masked_psnr", nullptr}};
  nlohmann::json better = figures, other = figures;
  better["psnr"] = 23;
  other["psnr"] = 100;
  RunRecord differs = record_with_seed(3);
  differs.settings["weight.kl"] = "7";
  RunRecord sparser = record_with_seed(4);
  sparser.reading.holdout = 9;
  measured_run("sparser", sparser, other);
  const Words runs = {measured_run("seed1", record_with_seed(1), figures), measured_run("other", differs, other),
                      measured_run("seed2", record_with_seed(2), better)};
  const Outcome compared =
      cloam_with({"compare", runs[0], runs[1], runs[2], (scratch() / "sparser").string(), "--json"});
  REQUIRE_MESSAGE(compared.code == 0, compared.err);
  const auto json = nlohmann::json::parse(compared.out);
  CHECK(json.at("runs").size() == 4);
  CHECK(json.at("runs").at(1).at("psnr") == 100);
  CHECK(json.at("runs").at(2).at("seed") == 2);
  REQUIRE(json.at("means").size() == 1);
  const auto mean = json.at("means").at(0);
  CHECK(mean.at("seeds") == std::vector<int>{1, 2});
  CHECK(mean.at("psnr").at("mean") == doctest::Approx(21.5));
  CHECK(mean.at("psnr").at("deviation") == doctest::Approx(3 / std::sqrt(2)));
  CHECK_FALSE(mean.contains("masked_psnr"));
  RunRecord elsewhere = record_with_seed(5);
  elsewhere.data = {{"another", "street", {}}};
  nlohmann::json best = figures;
  best["psnr"] = 29;
  Words all = {"compare", runs[0], runs[1], runs[2], measured_run("elsewhere", elsewhere, best), "--json"};
  CHECK(nlohmann::json::parse(cloam_with(all).out).at("means").at(0).at("seeds") == std::vector<int>{1, 2});
  all.push_back("--across-data");
  const auto across = nlohmann::json::parse(cloam_with(all).out).at("means");
  REQUIRE(across.size() == 1);
  CHECK(across.at(0).at("seeds") == std::vector<int>{1, 2, 5});
  CHECK(across.at(0).at("psnr").at("mean") == doctest::Approx(24));
  const Outcome table = cloam_with({"compare", runs[0], runs[1], runs[2]});
  CHECK(table.out.find("21.50 +- 2.12") != std::string::npos);
  CHECK(table.out.find("masked") == std::string::npos);
  CHECK(cloam_with({"compare", runs[0], (scratch() / "seed3").string()}).code == 2);
  CHECK(cloam_with({"compare", runs[0], "--protocol", "dense"}).code == 2);
  CHECK(cloam_with({"compare", small_street().string()}).code == 3);
}

TEST_CASE("compare evaluates what is not evaluated yet, by another protocol, or at an earlier step") {
  const std::string run = small_street_run().string();
  const fs::path kept = RunPaths{run}.eval() / "eval.json";
  const auto protocol_of = [&](const Words& more) {
    Words words = {"compare", run, "--json"};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome compared = cloam_with(words);
    REQUIRE_MESSAGE(compared.code == 0, compared.err);
    return nlohmann::json::parse(compared.out).at("runs").at(0).at("protocol").get<std::string>();
  };
  CHECK(protocol_of({"--protocol", "sparse"}) == "sparse");
  auto eval = json_of(kept);
  const double psnr = eval.at("psnr");
  eval["psnr"] = 99;
  write_text(kept, eval.dump());
  CHECK(protocol_of({}) == "sparse");  // what is there
  CHECK(json_of(kept).at("psnr") == 99);
  eval["step"] = 0;
  write_text(kept, eval.dump());
  CHECK(protocol_of({"--protocol", "sparse"}) == "sparse");
  CHECK(json_of(kept).at("psnr") == psnr);
  eval = json_of(kept);
  eval["psnr"] = 99, eval["schema_version"] = 1;  // of an earlier version, whose figures mean something else
  write_text(kept, eval.dump());
  CHECK(protocol_of({"--protocol", "sparse"}) == "sparse");
  CHECK(json_of(kept).at("psnr") == psnr);
}
