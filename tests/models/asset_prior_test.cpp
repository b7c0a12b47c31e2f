// Stage 2 of GenAssets on made codes whose statistics are known: what is read, held out and standardised, and that
// samples follow their class.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <set>

#include "models/io/tensors.h"
#include "models/methods/code_set.h"
#include "models/methods/diffusion.h"
#include "models/runs/restore_run.h"
#include "models/train/trainer.h"
#include "runtime/error.h"
#include "runtime/ops.h"
#include "tests/models/folder.h"
#include "tests/models/resume.h"

using namespace cloam;

namespace {

constexpr int64_t kChannels = 2, kSide = 2, kNumbers = kChannels * kSide * kSide;
constexpr float kLogVariance = 3;  // of all codes but plain ones, over the start's -6

struct MadeRun {
  bool variational = true;
  int actors = 20;           // a log: one of the day, one of the night
  bool last_unseen = false;  // the last actor of each log was seen in no step
  bool people = true;        // every second actor; else all are cars
};

/// Cars have codes about 3 in the first channel, people about -1; the second channel is 5 everywhere.
float made_code(bool car, int64_t i, int actor) {
  const float spread = 0.1f * static_cast<float>(actor % 5 - 2);
  return i < kSide * kSide ? (car ? 3.f : -1.f) + spread : 5.f;
}

StoredRun made_run(const MadeRun& made) {
  StoredRun run;
  run.folder = "made";
  run.record.method = run.record.preset = "genassets";
  run.record.settings = {{"code.channels", "2"}, {"code.side", "2"}};
  run.record.settings["code.variational"] = made.variational ? "true" : "false";
  for (int log = 0; log < 2; ++log) {
    Scene scene;
    scene.is_log = true;
    scene.night = log == 1;
    std::vector<float> rows;
    std::vector<int32_t> steps;
    for (int a = 0; a < made.actors; ++a) {
      const bool car = a % 2 == 0 || !made.people;
      scene.actors.push_back({std::to_string(a),
                              car ? "Car" : "Pedestrian",
                              car ? Eigen::Vector3d(2, 4 + 0.5 * (a % 5), 1.5) : Eigen::Vector3d(0.5, 0.5, 1.8),
                              false,
                              {},
                              {}});
      for (int64_t i = 0; i < kNumbers; ++i) rows.push_back(made_code(car, i, a));
      if (made.variational) rows.insert(rows.end(), kNumbers, kLogVariance);
      steps.push_back(made.last_unseen && a + 1 == made.actors ? 0 : 7);
    }
    const std::string name = "log" + std::to_string(log) + ".codes";
    const int64_t width = kNumbers * (made.variational ? 2 : 1);
    run.checkpoint.file.tensors["param." + name] = named(from_host(rows, {made.actors, width}));
    run.checkpoint.file.tensors["adam.steps." + name] = named(from_host(steps, {made.actors}));
    run.scenes.push_back(scene);
  }
  return run;
}

AssetCodes codes_of(const StoredRun& run, int64_t min_steps) { return asset_codes(source_of(run), min_steps); }

/// The smallest network on a made run.
void prepare(Diffusion& method, const StoredRun& run, uint64_t seed, const std::map<std::string, std::string>& more) {
  Config config;
  method.configure(config);
  std::map<std::string, std::string> settings = {
      {"unet.base", "16"},   {"unet.multipliers", "1,2"}, {"unet.groups", "4"},        {"unet.blocks", "1"},
      {"batch.codes", "32"}, {"train.rate", "5e-3"},      {"train.final_rate", "0.1"}, {"train.ema", "0.95"}};
  for (const auto& [key, value] : method.settings_from(source_of(run))) settings[key] = value;
  for (const auto& [key, value] : more) settings[key] = value;
  for (const auto& [key, value] : settings) config.set(key, value, "test");
  method.build(run.scenes, seed);
  method.load(source_of(run));
}

struct Prior {
  Diffusion method;
  explicit Prior(const StoredRun& run, uint64_t seed = 3, const std::map<std::string, std::string>& more = {}) {
    prepare(method, run, seed, more);
  }
};

std::vector<float> state_of(const Diffusion& method, const char* name) {
  return tensor_from(method.state(), name, {kChannels}).to_host();
}

}  // namespace

TEST_CASE("codes of a run come with class, time of day, size and deviation; actors that were not seen are left out") {
  const AssetCodes codes = codes_of(made_run({true, 6, true}), 1);
  REQUIRE(codes.count() == 10);
  CHECK(codes.unseen == 2);
  CHECK(codes.classes == std::vector<int32_t>{0, 7, 0, 7, 0, 0, 7, 0, 7, 0});
  CHECK(codes.nights == std::vector<int32_t>{0, 0, 0, 0, 0, 1, 1, 1, 1, 1});
  CHECK(codes.sizes[7] == Eigen::Vector3d(2, 5, 1.5));
  REQUIRE(codes.means.size() == 10 * kNumbers);
  CHECK(codes.means[kNumbers] == doctest::Approx(made_code(false, 0, 1)));
  CHECK(codes.deviations[5] == doctest::Approx(std::exp(0.5 * (3 - 6))));
  CHECK(codes_of(made_run({false, 6, false}), 1).deviations.empty());
  CHECK_THROWS_WITH_AS(codes_of(made_run({}), 8), doctest::Contains("no actor to learn from"), Error);
}

TEST_CASE("runs that have no codes are told apart, and what is damaged is no crash") {
  StoredRun run = made_run({});
  run.record.method = "nerf";
  CHECK_THROWS_WITH_AS(code_shape(source_of(run)), doctest::Contains("method is nerf"), Error);
  run = made_run({});
  run.record.settings["decoder.use"] = "false";
  CHECK_THROWS_WITH_AS(code_shape(source_of(run)), doctest::Contains("no codes"), Error);
  run = made_run({});
  run.record.edited_from = RunData{"runs/first", "", ""};
  CHECK_THROWS_WITH_AS(code_shape(source_of(run)), doctest::Contains("runs/first"), Error);
  run = made_run({});
  run.record.settings["code.side"] = "2000000000";
  CHECK_THROWS_AS(code_shape(source_of(run)), Error);
  run = made_run({});
  run.record.settings["code.channels"] = "3";
  CHECK_THROWS_WITH_AS(codes_of(run, 1), doctest::Contains("log0.codes"), Error);
  run = made_run({});
  run.checkpoint.file.tensors.erase("adam.steps.log1.codes");
  CHECK_THROWS_WITH_AS(codes_of(run, 1), doctest::Contains("log1.codes"), Error);
}

TEST_CASE("channels are standardised over what is drawn of the training codes; the seed chooses what is held out") {
  const StoredRun run = made_run({});
  Prior prior(run, 3);
  const PriorScore score = prior.method.score();
  CHECK(score.codes == 4);  // 10 % of 40
  CHECK(score.training_codes == 36);
  // The second channel is constant but for the codes' own deviation.
  const double own = std::exp(0.5 * (3 - 6));
  CHECK(state_of(prior.method, "mean")[1] == doctest::Approx(5));
  CHECK(state_of(prior.method, "deviation")[1] == doctest::Approx(own).epsilon(1e-3));
  CHECK(state_of(prior.method, "deviation")[0] == doctest::Approx(std::hypot(2, std::hypot(own, 0.14))).epsilon(0.03));
  std::set<std::vector<float>> means;
  for (uint64_t seed = 0; seed < 5; ++seed) means.insert(state_of(Prior(run, seed).method, "mean"));
  CHECK(means.size() > 1);
  CHECK(state_of(Prior(run, 3).method, "mean") == state_of(prior.method, "mean"));
}

TEST_CASE("a network that was never trained scores as predicting zero does, about 1") {
  Prior prior(made_run({}));
  const PriorScore score = prior.method.score();
  CHECK(score.v_loss == doctest::Approx(score.zero_v_loss).epsilon(1e-6));
  CHECK(score.zero_v_loss == doctest::Approx(1).epsilon(0.25));
}

TEST_CASE("the least v-loss is that of codes whose means are known") {
  const StoredRun run = made_run({});
  Prior prior(run);
  double want = 0;
  const NoiseSchedule schedule;
  for (int i = 0; i < 16; ++i)
    for (size_t channel = 0; channel < 2; ++channel) {
      const double own = std::exp(0.5 * (3 - 6)) / static_cast<double>(state_of(prior.method, "deviation")[channel]);
      const Level level = schedule.level(1000 * (2 * i + 1) / 32);
      // x given x_t has variance 1 / (1 / own^2 + alpha^2 / sigma^2), v that over sigma^2.
      want += 1 / (1 / (own * own) + std::pow(level.alpha / level.sigma, 2)) / std::pow(level.sigma, 2) / 32;
    }
  CHECK(prior.method.score().floor_v_loss == doctest::Approx(want).epsilon(1e-4));
  CHECK(Prior(made_run({false, 20, false})).method.score().floor_v_loss == 0);
  CHECK(Prior(run, 3, {{"data.drawn", "false"}}).method.score().floor_v_loss == 0);
}

TEST_CASE("the Wiener denoiser's v-loss is what theory says of codes whose Gaussian is known") {
  Prior prior(made_run({.actors = 200}));
  const double own = std::exp(3 - 6), spread = 0.02;  // variances: of each number, of all that a car's first has
  const auto standardised = [&](double variance, size_t channel) {
    return variance / std::pow(static_cast<double>(state_of(prior.method, "deviation")[channel]), 2);
  };
  // A car's four numbers of the first channel move together, so one eigenvalue has all of their spread.
  std::vector<double> eigenvalues(8, standardised(own, 0));
  eigenvalues[0] = standardised(own + 4 * spread, 0);
  for (size_t i = 4; i < 8; ++i) eigenvalues[i] = standardised(own, 1);
  double want = 0;
  const NoiseSchedule schedule;
  for (int i = 0; i < 16; ++i)
    for (const double value : eigenvalues) {
      const Level level = schedule.level(1000 * (2 * i + 1) / 32);
      want += value / (level.alpha * level.alpha * value + level.sigma * level.sigma) / 128;
    }
  const PriorScore score = prior.method.score();
  CHECK(score.wiener_v_loss == doctest::Approx(want).epsilon(0.05));
  CHECK(score.wiener_v_loss < 0.9 * score.zero_v_loss);
  CHECK(score.shrinkage.diagonal > 0);
  CHECK(score.shrinkage.own + score.shrinkage.pooled + score.shrinkage.diagonal == doctest::Approx(1));
  CHECK(prior.method.score().wiener_v_loss == score.wiener_v_loss);
}

TEST_CASE("Gaussian codes have the mean and the full covariance of their class, mean codes the mean alone") {
  Prior prior(made_run({.actors = 100}));
  AssetRequest wish;
  wish.count = 400, wish.seed = 5, wish.codes = CodeSource::gaussian;
  for (const int asset_class : {0, 7}) {
    wish.asset_class = asset_class;
    const std::vector<NewAsset> assets = prior.method.generate(wish);
    const double middle = asset_class == 0 ? 3 : -1, variance = std::exp(3 - 6) + 0.02;
    double mean = 0, squares = 0, together = 0;
    for (const NewAsset& asset : assets) {
      const double a = static_cast<double>(asset.code[0]) - middle, b = static_cast<double>(asset.code[3]) - middle;
      mean += a / 400, squares += a * a / 400, together += a * b / 400;
      CHECK(asset.asset_class == asset_class);
    }
    CHECK(std::abs(mean) < 0.06);
    CHECK(squares == doctest::Approx(variance).epsilon(0.25));
    CHECK(together == doctest::Approx(0.02).epsilon(0.6));  // white noise has 0
    CHECK(prior.method.generate(wish)[7].code == assets[7].code);
  }
  wish.codes = CodeSource::mean, wish.count = 2, wish.night = false;
  const std::vector<NewAsset> means = prior.method.generate(wish);
  CHECK(means[0].code == means[1].code);
  CHECK(means[0].code[0] == doctest::Approx(-1).epsilon(0.05));
  CHECK(means[0].size.z() == doctest::Approx(1.8));
}

TEST_CASE("the weighted loss is the v-loss by its weights; metrics show the v-loss") {
  Prior even(made_run({})), weighted(made_run({}), 3, {{"weight.min_snr", "5"}});
  const Progress progress{1, 10, 3};
  const Step step = weighted.method.step(progress, {});
  const Tensor a = even.method.step(progress, {}).loss, b = step.loss;
  eval({a, b, step.figures.front().pending});
  CHECK(step.figures.front().value() == doctest::Approx(static_cast<double>(a.item())));
  CHECK(b.item() < a.item());  // min(SNR, 5) / (SNR + 1) is below 1 everywhere
  CHECK(b.item() > 0);
}

TEST_CASE("held-out codes are told from noise, and samples have the class that was wished for") {
  const StoredRun run = made_run({});
  Prior prior(run);
  const Folder folder;
  TrainOptions options;
  options.steps = 150;
  train({prior.method, folder.path, {}}, options, {});
  const PriorScore score = prior.method.score();
  CAPTURE(score.v_loss);
  CHECK(score.v_loss < 0.7 * score.zero_v_loss);
  CHECK(score.v_loss > score.floor_v_loss);
  CHECK(score.training_v_loss < 0.7 * score.zero_v_loss);
  AssetRequest wish;
  wish.count = 8, wish.seed = 5, wish.steps = 20;
  for (const bool car : {true, false}) {
    wish.asset_class = car ? 0 : 7;
    const std::vector<NewAsset> assets = prior.method.generate(wish);
    REQUIRE(assets.size() == 8);
    int right = 0;
    for (const NewAsset& asset : assets) {
      float first = 0;
      for (size_t i = 0; i < 4; ++i) first += asset.code[i] / 4;
      right += (first > 1) == car;
      CHECK(asset.code[5] == doctest::Approx(5).epsilon(0.3));
      CHECK(asset.size.z() == doctest::Approx(car ? 1.5 : 1.8));
    }
    CHECK(right == 8);
  }
}

TEST_CASE("the same wish gives the same assets; what is not wished for is as in training") {
  Prior prior(made_run({}));
  AssetRequest wish;
  wish.count = 40, wish.seed = 1, wish.steps = 2;
  const auto first = prior.method.generate(wish), again = prior.method.generate(wish);
  int cars = 0, nights = 0;
  for (size_t i = 0; i < first.size(); ++i) {
    CHECK(first[i].code == again[i].code);
    cars += first[i].asset_class == 0;
    nights += first[i].night;
    CHECK(first[i].size == again[i].size);
  }
  CHECK(std::abs(cars - 20) < 12);
  CHECK(std::abs(nights - 20) < 12);
  wish.seed = 2;
  CHECK(prior.method.generate(wish)[0].code != first[0].code);
  wish.asset_class = 2;
  CHECK_THROWS_WITH_AS(prior.method.generate(wish), doctest::Contains("no Bus was in the training set"), Error);
  wish.asset_class = 0, wish.night = true;
  for (const NewAsset& asset : prior.method.generate(wish)) CHECK((asset.night && asset.asset_class == 0));
}

TEST_CASE("parts of a wish are the assets that it gives as a whole, wherever codes come from") {
  Prior prior(made_run({.actors = 100}));
  using enum CodeSource;
  for (const CodeSource source : {sampled, gaussian, random, training}) {
    CAPTURE(static_cast<int>(source));
    AssetRequest wish;
    wish.count = 80, wish.seed = 4, wish.steps = 2, wish.codes = source;
    const std::vector<NewAsset> whole = prior.method.generate(wish);
    REQUIRE(whole.size() > 64);
    std::vector<NewAsset> parts;
    for (wish.first = 0, wish.count = 64; wish.first < 80; wish.first += 64, wish.count = 16)
      for (NewAsset& asset : prior.method.generate(wish)) parts.push_back(std::move(asset));
    REQUIRE(parts.size() == whole.size());
    for (size_t i = 0; i < whole.size(); ++i) {
      CHECK(parts[i].asset_class == whole[i].asset_class);
      CHECK(parts[i].night == whole[i].night);
      // The network's convolutions may sum otherwise in a batch of another size.
      for (size_t k = 0; k < whole[i].code.size(); ++k)
        CHECK(parts[i].code[k] == doctest::Approx(whole[i].code[k]).epsilon(1e-4));
    }
    CHECK(parts[64].code != parts[0].code);
  }
}

TEST_CASE("diffusion: a checkpoint of any step holds all that the next step and samples read") {
  const StoredRun run = made_run({true, 8, false});
  check_resumes_from_every_step({[&] {
                                   auto method = std::make_unique<Diffusion>();
                                   prepare(*method, run, 3, {{"batch.codes", "8"}});
                                   return method;
                                 },
                                 [](Method& method) {
                                   AssetRequest wish;
                                   wish.count = 2;
                                   wish.steps = 2;
                                   std::vector<float> look;
                                   for (const NewAsset& asset : as<GeneratesAssets>(method)->generate(wish))
                                     look.insert(look.end(), asset.code.begin(), asset.code.end());
                                   return look;
                                 }});
}

TEST_CASE("assets like others are as many of each class and time of day, and no two of one noise") {
  Prior prior(made_run({}));
  std::vector<NewAsset> like;
  for (const auto& [asset_class, night] : {std::pair(7, true), {0, true}, {0, false}, {0, true}, {0, true}})
    like.push_back({asset_class, night, Eigen::Vector3d::Ones(), {}});
  for (const CodeSource source : {CodeSource::sampled, CodeSource::gaussian, CodeSource::random}) {
    const std::vector<NewAsset> assets = assets_like(prior.method, source, like);
    std::map<std::pair<int, bool>, int> counts;
    std::set<std::vector<float>> codes;
    for (const NewAsset& asset : assets) {
      ++counts[{asset.asset_class, asset.night}];
      codes.insert(asset.code);
    }
    CHECK(counts == std::map<std::pair<int, bool>, int>{{{0, false}, 1}, {{0, true}, 3}, {{7, true}, 1}});
    CHECK(codes.size() == assets.size());
  }
}

TEST_CASE("an asset has the box of the training actor of its class whose code is nearest") {
  Prior prior(made_run({.variational = false, .people = false}));
  AssetRequest wish;
  wish.count = 20, wish.seed = 4, wish.steps = 3, wish.asset_class = 0;
  std::set<double> lengths;
  for (const NewAsset& asset : prior.method.generate(wish)) {
    // Cars whose codes are 0.1 x k off have lengths of 5 + 0.5 k, k from -2 to 2; the second channel tells none apart.
    double middle = 0;
    for (size_t i = 0; i < 4; ++i) middle += static_cast<double>(asset.code[i]) / 4;
    const double k = std::clamp(std::round((middle - 3) / 0.1), -2., 2.);
    CHECK(asset.size == Eigen::Vector3d(2, 5 + 0.5 * k, 1.5));
    lengths.insert(asset.size.y());
  }
  CHECK(lengths.size() > 1);
}

TEST_CASE("settings of the network that cannot be are told with their names") {
  const StoredRun run = made_run({});
  const auto error_of = [&](const std::string& key, const std::string& value) -> std::string {
    try {
      Prior(run, 3, {{key, value}});
    } catch (const Error& error) { return error.what(); }
    return "";
  };
  CHECK(error_of("unet.multipliers", "1,2,4").find("unet.multipliers") != std::string::npos);
  CHECK(error_of("unet.base", "18").find("unet.base") != std::string::npos);
  CHECK(error_of("unet.groups", "5").find("unet.groups") != std::string::npos);
  CHECK(error_of("batch.codes", "0").find("batch.codes") != std::string::npos);
  CHECK(error_of("condition.drop", "1").find("condition.drop") != std::string::npos);
  CHECK(error_of("schedule.timesteps", "0").find("times") != std::string::npos);
  CHECK(error_of("schedule.betas", "square").find("square") != std::string::npos);
  CHECK(error_of("code.side", "4").find("code.side") != std::string::npos);
}
