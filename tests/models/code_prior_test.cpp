// A prior in the training of genassets: exact denoisers of a Gaussian take the place of a network, so that it is known
// where codes must go.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>

#include "models/io/checkpoint.h"
#include "models/methods/genassets.h"
#include "models/methods/registry.h"
#include "models/train/trainer.h"
#include "runtime/error.h"
#include "tests/models/made_method.h"
#include "tests/models/resume.h"
#include "tests/models/toy_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

constexpr int64_t kChannels = 4, kSide = 4, kNumbers = kChannels * kSide * kSide;
constexpr float kPriorMean = 0.8f, kPriorDeviation = 0.1f;  // of all codes

/// Knows codes N(0.8, 0.1^2), which standardised are N(0, 1): x^ = alpha x_t.
CodeDenoiser gaussian() {
  CodeDenoiser out;
  out.side = kSide;
  out.mean.assign(kChannels, kPriorMean);
  out.deviation.assign(kChannels, kPriorDeviation);
  out.clean = [schedule = out.schedule](const Tensor& noisy, const std::vector<int32_t>& times, const Condition&) {
    std::vector<float> alphas;
    for (const int32_t t : times) alphas.push_back(static_cast<float>(schedule.level(t).alpha));
    return noisy * from_host(alphas, {noisy.dim(0), 1, 1, 1});
  };
  return out;
}

struct Made {
  Settings settings = {};
  std::vector<size_t> photos = {0};
  bool prior = true;
};

std::unique_ptr<Method> street(const Scene& scene, const Made& made, const CodeDenoiser& denoiser = gaussian()) {
  Settings settings = {
      {"planes.channels", "4"},   {"background.side", "32"},   {"code.side", "4"},         {"code.channels", "4"},
      {"decoder.widths", "8,8"},  {"decoder.middle", "8"},     {"decoder.groups", "4"},    {"field.width", "16"},
      {"image.width", "8"},       {"image.kernel", "3"},       {"image.blocks", "2"},      {"image.upsamplings", "1"},
      {"batch.patches", "2"},     {"batch.patch_side", "12"},  {"batch.lidar_rays", "64"}, {"steps.actor", "0.1"},
      {"weight.perceptual", "0"}, {"weight.adversarial", "0"}, {"weight.kl", "0"},         {"shadows", "false"}};
  settings.insert(settings.end(), made.settings.begin(), made.settings.end());
  auto method = configured("genassets", settings);
  method->build({scene}, 1);
  if (made.prior) as<TakesPrior>(*method)->adopt_prior(denoiser);
  fill(*method, -0.4f);
  Pixels all = toy_pixels(scene), pixels = all;
  pixels.frames.clear();
  for (const size_t i : made.photos) pixels.frames.push_back(all.frames[i]);
  load_data(*method, scene, std::move(pixels));
  return method;
}

/// One car hides the other; a third is where the camera does not look.
Scene crossing(const fs::path& root) {
  Scene scene = toy_street(root);
  scene.actors = {toy_actor("behind", {2, 4, 1.5}, -20, 0), toy_actor("front", {2, 3, 6}, 8, 0),
                  toy_actor("hidden", {2, 2, 1.5}, 14, 0)};
  return scene;
}

/// Means of an actor's code as it is rendered.
std::vector<float> code_of(Method& method, size_t actor) {
  const Tensor& codes = method.parameters().at("log0.codes");
  const std::vector<float> all = codes.to_host();
  const auto begin = all.begin() + static_cast<std::ptrdiff_t>(actor) * codes.dim(1);
  return {begin, begin + kNumbers};
}

double distance(const std::vector<float>& a, const std::vector<float>& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += std::pow(static_cast<double>(a[i]) - static_cast<double>(b[i]), 2);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

double from_mean(const std::vector<float>& code) { return distance(code, std::vector<float>(code.size(), kPriorMean)); }

fs::path train_to(Method& method, const fs::path& folder, int64_t steps, int64_t stop_after = 0,
                  const SafetensorsFile* from = nullptr) {
  TrainOptions options;
  options.steps = steps;
  options.stop_after = stop_after;
  return train({method, folder, {}, from, nullptr}, options, {}).checkpoint;
}

double norm(const Tensor& gradient) { return static_cast<double>(sqrt(sum(square(gradient))).item()); }

}  // namespace

TEST_CASE("prior: codes that nothing is rendered of go to the prior's mean, without a prior they do not") {
  const Folder folder;
  const Scene scene = crossing(folder.path);
  for (const bool prior : {true, false}) {
    CAPTURE(prior);
    // Two photos: no denoising. The hidden actor is met and gets no gradient from the image.
    const auto method =
        street(scene, {{{"weight.prior", "1"}, {"batch.lidar_rays", "0"}, {"train.rate_codes", "0.3"}}, {0, 1}, prior});
    const double before = from_mean(code_of(*method, 2));
    (void)train_to(*method, folder.path / (prior ? "with" : "without"), 80);
    CHECK(before > 0.6);
    if (prior) CHECK(from_mean(code_of(*method, 2)) < 0.5 * before);
    if (!prior) CHECK(from_mean(code_of(*method, 2)) > 0.9 * before);
  }
}

TEST_CASE("prior: its gradient by codes is the share of the rendering's that the weight says, once that is measured") {
  const Folder folder;
  const Scene scene = crossing(folder.path);
  for (const char* through : {"false", "true"}) {
    const Settings settings = {{"prior.through_network", through}, {"weight.prior", "0.1"}, {"batch.patch_side", "16"}};
    const auto with = street(scene, {settings, {0, 1}}), without = street(scene, {settings, {0, 1}, false});
    const auto gradient = [](Method& method, int64_t step) {
      const Step all = method.step({step, 100, 1}, {method.parameters().at("log0.codes")});
      eval(all.more);
      const Tensor out = stop_gradient(all.gradients[0]);
      eval({out});
      method.after_step({step, 100, 1});
      return out;
    };
    double rendering = 0, term = 0;
    for (int64_t step = 1; step <= 40; ++step) {
      const Tensor all = gradient(*with, step), plain = gradient(*without, step);
      if (step <= 16) CHECK(norm(all - plain) == 0);  // these measure
      if (step <= 16) continue;
      rendering += norm(plain);
      term += norm(all - plain);
    }
    CHECK(term / rendering > 0.05);
    CHECK(term / rendering < 0.2);
    CHECK(figure(with->step({41, 100, 1}, {}), "prior") > 0);
  }
}

TEST_CASE(
    "prior: denoising begins a run on one image; what is hidden gets the prior's sample, what is seen is guided") {
  const Folder folder;
  const Scene scene = crossing(folder.path);
  const auto denoised = [&](const char* guidance, const char* name) {
    const auto method = street(scene, {{{"prior.steps", "8"},
                                        {"prior.guidance", guidance},
                                        {"prior.noise", "1"},
                                        {"code.variational", "false"},
                                        {"batch.lidar_rays", "0"}}});
    const std::vector<float> unseen = code_of(*method, 0);
    (void)train_to(*method, folder.path / name, 8);
    CHECK(distance(code_of(*method, 0), unseen) == 0);  // the image does not show it
    return std::array{code_of(*method, 1), code_of(*method, 2)};
  };
  const auto free = denoised("0", "free"), guided = denoised("0.5", "guided");
  // Samples of the prior: about its mean, and its deviation wide.
  for (const auto& code : free) {
    CHECK(from_mean(code) > 0.6 * static_cast<double>(kPriorDeviation));
    CHECK(from_mean(code) < 1.4 * static_cast<double>(kPriorDeviation));
  }
  CHECK(distance(guided[1], free[1]) < 1e-4);
  CHECK(distance(guided[0], free[0]) > 0.3 * static_cast<double>(kPriorDeviation));
}

TEST_CASE("prior: without noise the hidden gets what is usual; what is seen tells of all that must go with it") {
  const Folder folder;
  const Scene scene = crossing(folder.path);
  CodeDenoiser one_number = gaussian();  // knows that all numbers of a code are equal
  one_number.clean = [all = one_number.clean](const Tensor& noisy, const std::vector<int32_t>& times,
                                              const Condition& condition) {
    return all(mean(noisy, {{1, 2, 3}, true}) + zeros(noisy.shape()), times, condition);
  };
  const auto method =
      street(scene, {{{"prior.steps", "8"}, {"code.variational", "false"}, {"batch.lidar_rays", "0"}}}, one_number);
  (void)train_to(*method, folder.path / "run", 8);
  CHECK(from_mean(code_of(*method, 2)) < 1e-5);
  const std::vector<float> seen = code_of(*method, 1);
  CHECK(from_mean(seen) > 0.3 * static_cast<double>(kPriorDeviation));
  CHECK(distance(seen, std::vector<float>(seen.size(), seen.front())) < 1e-5);
}

TEST_CASE("prior: denoised codes are refined") {
  const Folder folder;
  const Scene scene = crossing(folder.path);
  const auto method = street(scene, {{{"prior.steps", "4"}}});
  (void)train_to(*method, folder.path / "run", 8, 4);
  const std::vector<float> denoised = code_of(*method, 1);
  const SafetensorsFile saved = load_latest_checkpoint(folder.path / "run").file;
  (void)train_to(*method, folder.path / "run", 8, 0, &saved);
  CHECK(distance(code_of(*method, 1), denoised) > 1e-4);
  const auto rate = [](const Method& of) {
    const ParameterGroup codes = group_of("log0.codes", of.groups());
    return static_cast<double>(codes.rate_at({300, 1000, 1}));
  };
  CHECK(rate(*method) == doctest::Approx(0.1 * rate(*street(scene, {{{"prior.steps", "0"}}}))));
}

TEST_CASE("prior: denoising is of runs on one image alone, and the optimiser leaves codes alone while it lasts") {
  const Folder folder;
  const Scene scene = crossing(folder.path);
  const auto method = street(scene, {{{"prior.steps", "4"}}});
  (void)train_to(*method, folder.path / "one", 3);
  const SafetensorsFile file = load_latest_checkpoint(folder.path / "one").file;
  CHECK(file.tensors.at("state.prior.noisy").shape == std::vector<int64_t>{2, kChannels, kSide, kSide});
  const auto& steps = file.tensors.at("adam.steps.log0.codes").data;
  CHECK(std::all_of(steps.begin(), steps.end(), [](std::byte b) { return b == std::byte{0}; }));
  const auto two = street(scene, {{{"prior.steps", "4"}}, {0, 1}});
  CHECK_FALSE(two->state().contains("prior.noisy"));
  CHECK_FALSE(street(scene, {{{"prior.steps", "0"}}})->state().contains("prior.noisy"));
  CHECK_FALSE(street(scene, {{}, {0}, false})->state().contains("prior.noisy"));
}

TEST_CASE("prior: guesses begin a run on one image: the class's mean code, or the best of its training codes") {
  const Folder folder;
  const Scene scene = crossing(folder.path);
  std::vector<std::vector<float>> examples;
  for (int i = 0; i < 5; ++i)
    examples.push_back(random_normal({kNumbers}, {uint64_t{7}, static_cast<uint32_t>(i), 0}).to_host());
  CodeDenoiser denoiser = gaussian();
  denoiser.examples = [&](int32_t asset_class, int32_t night) {
    CHECK(asset_class == 0);
    CHECK(night == 0);
    return examples;
  };
  std::vector<float> mean(examples[0].size());
  for (const auto& code : examples)
    for (size_t i = 0; i < mean.size(); ++i) mean[i] += code[i] / 5;
  const auto at = [&](const char* start, int64_t steps) {
    const auto method = street(scene, {{{"prior.start", start}, {"prior.steps", "4"}}}, denoiser);
    (void)train_to(*method, folder.path / text(start, steps), 6, steps);
    return code_of(*method, 1);
  };
  for (const char* start : {"class-mean", "nearest"}) CHECK(distance(at(start, 3), mean) < 1e-6);
  CHECK(distance(at("class-mean", 4), mean) < 1e-6);
  CHECK(distance(at("class-mean", 6), mean) > 1e-5);  // refined
  CHECK(figure(street(scene, {{{"prior.start", "class-mean"}}}, denoiser)->step({40, 100, 1}, {}), "prior") == 0);

  // The photo shows the car with one of the codes: that is the one that is chosen.
  const auto painter = street(scene, {{{"prior.start", "class-mean"}, {"prior.steps", "1"}}}, denoiser);
  for (const size_t wanted : {1, 3}) {
    const Tensor& codes = painter->parameters().at("log0.codes");
    std::vector<float> rows = codes.to_host();
    std::copy(examples[wanted].begin(), examples[wanted].end(), rows.begin() + codes.dim(1));
    assign({{codes, from_host(rows, codes.shape())}});
    const Picture picture = shown(*painter, {scene.cameras[0], toy_camera_pose(0), 0, 0});
    Pixels photo = toy_pixels(scene);
    photo.frames.resize(1);
    FramePixels& frame = photo.frames[0];
    for (size_t i = 0; i < picture.rgb.size() / 3; ++i)
      for (size_t c = 0; c < 3; ++c)
        frame.rgba[4 * i + c] = static_cast<uint8_t>(std::lround(255 * picture.rgb[3 * i + c]));
    const auto method = street(scene, {{{"prior.start", "nearest"}, {"prior.steps", "1"}}}, denoiser);
    load_data(*method, scene, std::move(photo));
    (void)train_to(*method, folder.path / text("near", wanted), 2, 1);
    CHECK(distance(code_of(*method, 1), examples[wanted]) < 1e-6);
  }
}

TEST_CASE("prior: a checkpoint of any step holds all that the next one reads, while codes are denoised and later") {
  const Folder folder;
  const Scene scene = crossing(folder.path);
  for (const char* whole : {"false", "true"}) {
    CAPTURE(whole);
    const Settings settings = {{"prior.steps", "3"}, {"prior.through_network", whole}, {"batch.whole_images", whole}};
    check_resumes_from_every_step({[&] { return street(scene, {settings}); },
                                   [&](Method& method) {
                                     return shown(method, {scene.cameras[0], toy_camera_pose(0), 0, 0.05}).rgb;
                                   },
                                   8});
  }
}

TEST_CASE("prior: what cannot be is an error that names it") {
  const Folder folder;
  const Scene scene = crossing(folder.path);
  const auto fails = [&](const Settings& settings, const char* says, const CodeDenoiser& denoiser = gaussian()) {
    CHECK_THROWS_WITH_AS((void)street(scene, {settings}, denoiser), doctest::Contains(says), Error);
  };
  fails({{"decoder.use", "false"}}, "decoder.use");
  fails({{"code.side", "8"}}, "codes of 4x4x4, the settings say 4x8x8");
  fails({{"weight.prior", "-1"}}, "weight.prior");
  fails({{"prior.guidance", "nan"}}, "prior.guidance");
  fails({{"prior.noise", "-1"}}, "prior.noise");
  fails({{"prior.start", "mean"}}, "prior.start: \"mean\", want diffusion, class-mean or nearest");
  fails({{"prior.start", "nearest"}}, "the codes that the prior learned from are not loaded");
  fails({{"prior.steps", "1001"}}, "1001 denoising steps");
  CHECK_THROWS_WITH_AS(require<TakesPrior>(*make_method("nerf"), "nerf", "--prior"),
                       doctest::Contains("--prior does not work with nerf\n  methods that it works with: genassets"),
                       Error);
}
