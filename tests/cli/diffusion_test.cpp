// Stage 2 through the program: a run that learns from a run, bytes that repeat, and what cannot be learned from.
#include <doctest/doctest.h>
#include <signal.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <set>

#include "models/io/image.h"
#include "models/io/safetensors.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

std::string last_checkpoint(const fs::path& run) { return content_of(run / "ckpt" / "000060.safetensors"); }

void change_record(const fs::path& run, const std::string& key, const std::string& value) {
  auto record = json_of(run / "run.json");
  record["settings"][key] = value;
  write_text(run / "run.json", record.dump());
}

}  // namespace

TEST_CASE("a run of diffusion records the run it learned from, with its codes' shape as settings") {
  const auto record = json_of(small_diffusion_run() / "run.json");
  CHECK(record.at("method") == "diffusion");
  CHECK(record.at("state") == "finished");
  CHECK(record.at("data").size() == 1);
  CHECK(record.at("data").at(0).at("relative") == "../two_streets_run");
  CHECK(contains(record.at("data").at(0).at("fingerprint"), "genassets, step 8, "));
  CHECK(record.at("settings").at("code.side") == "4");
  CHECK(contains(content_of(small_diffusion_run() / "config.toml"), "code.channels = 4  # run "));
  CHECK(json_of(small_diffusion_run() / "scene.json").at("scenes").size() == 2);
  const std::string events = content_of(small_diffusion_run() / "metrics.jsonl");
  CHECK(contains(events, "codes of 4x4x4 with variance"));
  CHECK(contains(events, "\"event\":\"end\",\"t\":"));
}

TEST_CASE("equal seeds of diffusion give equal bytes, others others") {
  const fs::path same = scratch() / "assets_again", other = scratch() / "assets_other";
  REQUIRE(cloam_with(small_diffusion(two_streets_run(), same, kDiffusionSteps), {"POCL_MAX_PTHREAD_COUNT=1"}).code ==
          0);
  CHECK(last_checkpoint(same) == last_checkpoint(small_diffusion_run()));
  REQUIRE(cloam_with(small_diffusion(two_streets_run(), other, {"--steps", "60", "--seed", "7"})).code == 0);
  CHECK(last_checkpoint(other) != last_checkpoint(small_diffusion_run()));
  CHECK_FALSE(contains(last_checkpoint(small_diffusion_run()), scratch().string()));
}

TEST_CASE("a killed run of diffusion that is resumed ends in the bytes of the one left alone") {
  const fs::path run = scratch() / "assets_killed";
  Process process(small_diffusion(two_streets_run(), run, kDiffusionSteps));
  REQUIRE(wait_for(run / "ckpt" / "000020.safetensors", process));
  process.signal(SIGKILL);
  CHECK(process.wait().code == -SIGKILL);
  const Outcome outcome = cloam_with({"train", "--resume", run.string(), "--pictures", "off"});
  CHECK_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(last_checkpoint(run) == last_checkpoint(small_diffusion_run()));
}

TEST_CASE("eval of a run of diffusion measures codes that were held out, beside predicting zero") {
  const Outcome evaluated = cloam_with({"eval", small_diffusion_run().string(), "--json"});
  REQUIRE_MESSAGE(evaluated.code == 0, evaluated.err);
  const auto json = nlohmann::json::parse(evaluated.out);
  CHECK(json.at("protocol") == "held-out-codes");
  CHECK(json.at("codes") >= 1);
  CHECK(json.at("training_codes") > json.at("codes"));
  CHECK(json.at("v_loss") > 0);
  CHECK(json.at("baseline_zero_v_loss") == doctest::Approx(1).epsilon(0.5));
  CHECK(json_of(small_diffusion_run() / "eval" / "eval.json").at("v_loss") == json.at("v_loss"));
  CHECK(json.at("copy_ratio") > 0);
  CHECK_FALSE(json.contains("frechet_feature_distance"));
  CHECK(cloam_with({"eval", small_diffusion_run().string(), "--protocol", "novel"}).code == 2);
  const Outcome smaller = cloam_with({"eval", small_diffusion_run().string(), "--downscale", "2"});
  CHECK(smaller.code == 2);
  CHECK(contains(smaller.err, "--downscale is for runs trained on images"));
  const Outcome rendered = cloam_with({"render", small_diffusion_run().string(), "-o", (scratch() / "none").string()});
  CHECK(rendered.code == 2);
  CHECK(contains(rendered.err, "cloam generate"));
  CHECK(cloam_with({"edit", small_diffusion_run().string(), "--list"}).code == 2);
}

TEST_CASE("eval of a run of diffusion with features compares pictures of samples with those of random codes") {
  const Outcome evaluated = cloam_with({"eval", small_diffusion_run().string(), "--json", "--features", "random"});
  REQUIRE_MESSAGE(evaluated.code == 0, evaluated.err);
  const auto json = nlohmann::json::parse(evaluated.out);
  CHECK(json.at("frechet_feature_distance") > 0);
  CHECK(json.at("baseline_random_frechet_feature_distance") > 0);
  CHECK(json.at("baseline_gaussian_frechet_feature_distance") > 0);
  CHECK(json.at("frechet_feature_distance") != json.at("baseline_random_frechet_feature_distance"));
  CHECK(json.at("baseline_training_frechet_feature_distance") > 0);
  CHECK(json.at("baseline_training_frechet_feature_distance") != json.at("frechet_feature_distance"));
  CHECK(json.at("set_images").at(0) == json.at("set_images").at(1));
  CHECK(contains(evaluated.err, " assets  left 0s"));  // as many were shown as it said there would be
}

TEST_CASE("what diffusion cannot learn from is one error, and makes no run") {
  const fs::path never = scratch() / "assets_never";
  const auto fails = [&](const fs::path& source, int code, const char* says, const Words& more = {}) {
    const Outcome outcome = cloam_with(small_diffusion(source, never, more));
    CAPTURE(outcome.err);
    CHECK(outcome.code == code);
    CHECK(contains(outcome.err, says));
    CHECK_FALSE(fs::exists(never));
  };
  fails(scratch() / "nothing_here", 2, "no such run folder");
  fails(small_street(), 3, "not a run folder: looked for run.json");
  fails(small_run(), 3, "method is nerf");
  const fs::path planes = copy_of(two_streets_run(), "planes_run");
  change_record(planes, "decoder.use", "false");
  fails(planes, 3, "decoder.use = false");
  const fs::path empty = copy_of(two_streets_run(), "empty_streets");
  auto scenes = json_of(empty / "scene.json");
  for (auto& scene : scenes.at("scenes")) scene["actors"] = nlohmann::json::array();
  write_text(empty / "scene.json", scenes.dump());
  fails(empty, 3, "no actor to learn from");
  const fs::path unsaved = copy_of(two_streets_run(), "unsaved_run");
  fs::remove_all(unsaved / "ckpt");
  fails(unsaved, 3, "no usable checkpoint");
  fails(two_streets_run(), 2, "--holdout is for captures", {"--holdout", "4"});
  fails(two_streets_run(), 2, "unet.groups", {"--set", "unet.groups=3"});
}

TEST_CASE("a source that is gone or was changed since is told; --data names its new place") {
  const fs::path source = copy_of(two_streets_run(), "moving_source"), run = scratch() / "assets_moving";
  REQUIRE(cloam_with(small_diffusion(source, run, {"--steps", "6", "--stop-after", "3"})).code == 0);
  const fs::path saved = source / "ckpt" / "000008.safetensors";
  SafetensorsFile changed = read_safetensors(saved);
  changed.tensors.at("param.log0.codes").data[0] ^= std::byte{1};
  write_safetensors(saved, changed);
  for (const Words& words : {Words{"train", "--resume", run.string()}, Words{"eval", run.string()}}) {
    const Outcome outcome = cloam_with(words);
    CAPTURE(outcome.err);
    CHECK(outcome.code == 3);
    CHECK(contains(outcome.err, "genassets, step 8, "));
  }
  fs::remove_all(source);
  const Outcome gone = cloam_with({"eval", run.string()});
  CHECK(gone.code == 3);
  CHECK(contains(gone.err, "is gone"));
  const Outcome moved = cloam_with({"train", "--resume", run.string(), "--data", two_streets_run().string()});
  CHECK_MESSAGE(moved.code == 0, moved.err);
  CHECK(cloam_with({"eval", run.string()}).code == 0);
}

namespace {

Words small_generation(const fs::path& out, const Words& more = {}) {
  Words words = {"generate",
                 small_diffusion_run().string(),
                 "-o",
                 out.string(),
                 "-n",
                 "2",
                 "--steps",
                 "4",
                 "--frames",
                 "2",
                 "--size",
                 "16",
                 "--resolution",
                 "8",
                 "-q"};
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

}  // namespace

TEST_CASE("generate makes latents, turntables, meshes and a grid; the same seed the same bytes, another others") {
  const Words car = {"--class", "car", "--time", "night", "--seed", "7", "--guidance", "2"};
  const fs::path first = scratch() / "made", again = scratch() / "made_again", other = scratch() / "made_other";
  const Outcome made = cloam_with(small_generation(first, car));
  REQUIRE_MESSAGE(made.code == 0, made.err);
  for (const char* name : {"latents.safetensors", "generate.json", "grid.png", "asset_000.gif", "asset_000.glb",
                           "asset_001.gif", "asset_001.glb"})
    CHECK_MESSAGE(fs::exists(first / name), name);
  const SafetensorsFile latents = read_safetensors(first / "latents.safetensors");
  CHECK(latents.tensors.at("latents").shape == std::vector<int64_t>{2, 4, 4, 4});
  CHECK(latents.metadata.at("seed") == "7");
  CHECK(latents.metadata.at("class") == "Car");
  CHECK(latents.metadata.at("time") == "night");
  CHECK(contains(latents.metadata.at("prior"), "diffusion, step 60, "));
  CHECK(contains(content_of(first / "asset_001.glb"), "\"guidance\":2.0"));
  CHECK(contains(content_of(first / "asset_001.gif").substr(0, 3), "GIF"));
  CHECK(contains(content_of(first / "asset_001.gif"), "\"class\":\"Car\""));
  CHECK(contains(content_of(first / "grid.png"), "\"seed\":7"));
  const auto json = json_of(first / "generate.json");
  CHECK(json.at("assets").size() == 2);
  CHECK(json.at("assets").at(1).at("triangles") > 0);
  CHECK(json.at("assets").at(1).at("size_m").at(1) > 3);  // a car is long
  REQUIRE(cloam_with(small_generation(again, car)).code == 0);
  CHECK(snapshot(again) == snapshot(first));
  Words seed8 = car;
  seed8[5] = "8";
  REQUIRE(cloam_with(small_generation(other, seed8)).code == 0);
  for (const char* name : {"latents.safetensors", "asset_000.glb"})
    CHECK_MESSAGE(content_of(other / name) != content_of(first / name), name);
  CHECK(read_safetensors(other / "latents.safetensors").tensors.at("latents") != latents.tensors.at("latents"));
}

TEST_CASE(
    "generate --codes training shows the codes that the run has, random ones a normal distribution of their spread") {
  const fs::path training = scratch() / "made_training", random = scratch() / "made_random";
  const Words quick = {"--codes",    "training", "-n", "1000",   "--no-meshes",
                       "--pictures", "--frames", "2",  "--size", "16"};
  Words words = {"generate", small_diffusion_run().string(), "-o", training.string(), "-q"};
  words.insert(words.end(), quick.begin(), quick.end());
  const Outcome shown = cloam_with(words);
  REQUIRE_MESSAGE(shown.code == 0, shown.err);
  const SafetensorsFile source = read_safetensors(two_streets_run() / "ckpt" / "000008.safetensors"),
                        prior = read_safetensors(small_diffusion_run() / "ckpt" / "000060.safetensors");
  const auto floats = [](const SafetensorsFile& file, const std::string& name) {
    const auto& data = file.tensors.at(name).data;
    std::vector<float> values(data.size() / sizeof(float));
    std::memcpy(values.data(), data.data(), data.size());
    return values;
  };
  constexpr std::size_t kNumbers = 4 * 4 * 4;
  std::set<std::vector<float>> known;
  for (const std::string log : {"param.log0.", "param.log1."}) {
    const auto rows = floats(source, log + "codes");  // means and log variances
    for (std::size_t row = 0; row < rows.size(); row += 2 * kNumbers)
      known.insert(std::vector<float>(&rows[row], &rows[row] + kNumbers));
  }
  const SafetensorsFile made = read_safetensors(training / "latents.safetensors");
  const auto latents = floats(made, "latents");
  const std::size_t count = latents.size() / kNumbers;
  CHECK(count > 5);
  CHECK(count < known.size());  // without those held out
  for (std::size_t i = 0; i < count; ++i)
    CHECK(known.contains(std::vector<float>(&latents[i * kNumbers], &latents[i * kNumbers] + kNumbers)));
  CHECK(made.metadata.at("codes") == "training");
  CHECK(fs::exists(training / "pictures" / "asset_000_0001.png"));
  CHECK_FALSE(fs::exists(training / "asset_000.glb"));

  words[3] = random.string();
  words[6] = "random";
  words[8] = "30";
  const Outcome drawn = cloam_with(words);
  REQUIRE_MESSAGE(drawn.code == 0, drawn.err);
  const auto codes = floats(read_safetensors(random / "latents.safetensors"), "latents");
  const auto mean = floats(prior, "state.mean"), deviation = floats(prior, "state.deviation");
  REQUIRE(codes.size() == 30 * kNumbers);
  double sum = 0, squares = 0;
  for (std::size_t i = 0; i < codes.size(); ++i) {
    const std::size_t channel = i / 16 % 4;
    const double z = static_cast<double>((codes[i] - mean[channel]) / deviation[channel]);
    sum += z;
    squares += z * z;
  }
  const double n = static_cast<double>(codes.size());
  CHECK(std::abs(sum / n) < 4 / std::sqrt(n));
  CHECK(std::abs(squares / n - 1) < 4 * std::sqrt(2 / n));
}

TEST_CASE("generate makes more assets than lie in memory at once; the sheet shows the first 256") {
  const fs::path many = scratch() / "made_many", few = scratch() / "made_few";
  const auto made = [](const fs::path& out, const std::string& count) {
    const Outcome outcome = cloam_with({"generate", small_diffusion_run().string(), "-o", out.string(), "-n", count,
                                        "--steps", "1", "--frames", "1", "--size", "16", "--no-meshes", "-q"});
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    return read_safetensors(out / "latents.safetensors").tensors.at("latents");
  };
  const NamedTensor all = made(many, "258"), first = made(few, "64");
  CHECK(all.shape == std::vector<int64_t>{258, 4, 4, 4});
  CHECK(std::equal(first.data.begin(), first.data.end(), all.data.begin()));
  CHECK_FALSE(std::equal(first.data.begin(), first.data.end(), all.data.begin() + std::ssize(first.data)));
  const auto rows = json_of(many / "generate.json").at("assets");
  REQUIRE(rows.size() == 258);
  for (std::size_t i = 0; i < rows.size(); ++i) CHECK(rows.at(i).at("asset") == i);
  CHECK(rows.at(257).at("turntable") == "asset_257.gif");
  CHECK(fs::exists(many / "asset_257.gif"));
  CHECK(content_of(many / "asset_063.gif") == content_of(few / "asset_063.gif"));
  constexpr int kSide = 16, kGap = 4;
  CHECK(read_image(many / "grid.png").width == 16 * (kSide + kGap) - kGap);
}

TEST_CASE("generate's mistakes: one line that says what would do, and nothing is written") {
  const fs::path never = scratch() / "made_never";
  const auto fails = [&](const Words& words, int code, const char* says) {
    const Outcome outcome = cloam_with(words);
    CAPTURE(outcome.err);
    CHECK(outcome.code == code);
    CHECK(contains(outcome.err, says));
    CHECK_FALSE(fs::exists(never));
  };
  fails(small_generation(never, {"--class", "Cra"}), 2, "did you mean Car?");
  fails(small_generation(never, {"--class", "Other"}), 2, "no Other was in the training set");
  fails(small_generation(never, {"--time", "noon"}), 2, "noon");
  fails({"generate", small_diffusion_run().string(), "-o", never.string(), "--steps", "1001"}, 2,
        "1001 denoising steps");
  fails({"generate", two_streets_run().string(), "-o", never.string()}, 2, "cloam train diffusion");
  fails({"generate", small_street().string(), "-o", never.string()}, 3, "not a run folder");
}

namespace {

/// A fit of one image of the first street, by networks that know others.
Words fit(const fs::path& run, const Words& more = {}) {
  const std::string log = (scratch() / "two_streets" / "001").string();
  Words words = {"train",   "genassets",       log,       "-o", run.string(), "--networks", two_streets_run().string(),
                 "--image", "front_camera/01", "--steps", "6",  "-q",         "--set",      "prior.steps=3"};
  words.insert(words.end(), more.begin(), more.end());
  return without_pictures(words);
}

Words fit_with_prior(const fs::path& run, const fs::path& prior, const Words& more = {}) {
  Words words = fit(run, {"--prior", prior.string()});
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

}  // namespace

TEST_CASE("a fit of one image with a prior is recorded, repeats, resumes while denoising and after, and is measured") {
  const fs::path prior = copy_of(small_diffusion_run(), "fit_prior"), whole = scratch() / "fit",
                 stopped = scratch() / "fit_stopped";
  const Outcome trained = cloam_with(fit_with_prior(whole, prior));
  REQUIRE_MESSAGE(trained.code == 0, trained.err);
  const auto record = json_of(whole / "run.json");
  CHECK(record.at("reading").at("image") == "front_camera/01");
  CHECK(record.at("prior").at("relative") == "../fit_prior");
  CHECK(record.at("settings").at("decoder.groups") == "4");  // of the networks' run
  CHECK(record.at("settings").at("prior.guidance") == "1");  // not of that run, which had no prior
  CHECK(contains(record.at("prior").at("fingerprint"), "diffusion, step 60, "));
  const std::string want = content_of(whole / "ckpt" / "000006.safetensors");
  CHECK_FALSE(contains(want, "fit_prior"));
  REQUIRE(cloam_with(fit_with_prior(stopped, prior, {"--stop-after", "2"})).code == 0);
  REQUIRE(cloam_with({"train", "--resume", stopped.string(), "--stop-after", "4", "--pictures", "off"}).code == 0);
  const fs::path moved = scratch() / "fit_prior_moved";
  fs::rename(prior, moved);
  const Outcome gone = cloam_with({"train", "--resume", stopped.string()});
  CHECK(gone.code == 3);
  CHECK(contains(gone.err, "the prior of"));
  CHECK(contains(gone.err, "--prior RUN"));
  const Outcome resumed =
      cloam_with({"train", "--resume", stopped.string(), "--prior", moved.string(), "--pictures", "off"});
  REQUIRE_MESSAGE(resumed.code == 0, resumed.err);
  CHECK(content_of(stopped / "ckpt" / "000006.safetensors") == want);
  const Outcome measured = cloam_with({"eval", whole.string(), "--protocol", "rotate360", "--json"});
  REQUIRE_MESSAGE(measured.code == 0, measured.err);
  const auto json = nlohmann::json::parse(measured.out);
  CHECK(json.at("images") == 8);  // one moment, eight angles
  CHECK(json.at("masked_psnr").is_number());
  CHECK(json.at("baseline_mean_masked_psnr").is_number());
}

TEST_CASE("a fit of one image without a prior is the same fit but for the prior") {
  const fs::path run = scratch() / "fit_alone";
  REQUIRE(cloam_with(fit(run)).code == 0);
  const SafetensorsFile file = read_safetensors(run / "ckpt" / "000006.safetensors");
  CHECK_FALSE(file.tensors.contains("state.prior.norms"));
  const auto scenes = json_of(run / "scene.json");
  CHECK_FALSE(scenes.at("scenes").at(0).at("sweeps").empty());
  for (const auto& sweep : scenes.at("scenes").at(0).at("sweeps"))
    CHECK(sweep.at("split") == (sweep.at("step") == 1 ? "train" : "unused"));
}

TEST_CASE("what a prior or an image cannot be is one error, and makes no run") {
  const fs::path never = scratch() / "fit_never";
  const auto fails = [&](const Words& words, int code, const char* says) {
    const Outcome outcome = cloam_with(words);
    CAPTURE(outcome.err);
    CHECK(outcome.code == code);
    CHECK(contains(outcome.err, says));
    CHECK_FALSE(fs::exists(never));
  };
  fails(fit_with_prior(never, two_streets_run()), 2, "is a run of genassets, want a diffusion run");
  fails(fit_with_prior(never, scratch() / "nothing_here"), 2, "no such run folder");
  fails(fit_with_prior(never, small_diffusion_run(), {"--set", "code.side=8"}), 2, "code.side");
  fails(fit(never, {"--holdout", "4"}), 2, "leave out --protocol and --holdout");
  const std::string log = (scratch() / "two_streets" / "001").string();
  const Words plain = {"train", "genassets", log, "-o", never.string()};
  const auto with = [&](const Words& more) {
    Words words = plain;
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  fails(with({"--prior", small_diffusion_run().string()}), 2, "also needs --networks RUN");
  fails(with({"--image", "front_camera/07"}), 2, "it has front_camera/0 to front_camera/2");
  fails(with({"--image", "front_camera"}), 2, "no such image");
  fails({"train", "nerf", small_scene().string(), "-o", never.string(), "--image", "front_camera/01"}, 2,
        "driving logs");
  // Networks of another training: its codes mean something else.
  const fs::path other = copy_of(two_streets_run(), "other_networks");
  const fs::path saved = other / "ckpt" / "000008.safetensors";
  SafetensorsFile changed = read_safetensors(saved);
  changed.tensors.at("param.networks.field.past.bias").data[0] ^= std::byte{1};
  write_safetensors(saved, changed);
  Words words = fit_with_prior(never, small_diffusion_run());
  *std::find(words.begin(), words.end(), two_streets_run().string()) = other.string();
  fails(words, 2, "whose networks are not those of");
}
