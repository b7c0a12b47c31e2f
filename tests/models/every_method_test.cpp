// What every method owes: it is built from settings, steps, is saved and resumed to the same bytes, is evaluated, and
// shows a picture or says by its type that it has none. A method that is registered takes part by its row; the method
// of CONTRIBUTING.md takes part as it stands there.
#include <doctest/doctest.h>

#include "models/eval/evaluate.h"
#include "models/io/checkpoint.h"
#include "models/latents/generates_assets.h"
#include "models/train/trainer.h"
#include "runtime/error.h"
#include "tests/models/resume.h"
#include "tests/models/worlds.h"
#include "tutorial_method.h"

using namespace cloam;

namespace {

using Make = std::function<std::unique_ptr<Method>()>;

/// As a user sees it: a render, else samples.
std::vector<float> look(Method& method, const Worlds& worlds) {
  const Scene& scene = worlds.scene_of(method);
  if (as<RendersViews>(method)) return shown(method, view_of(scene.frames.front(), scene.cameras.front(), 0)).rgb;
  REQUIRE_MESSAGE(as<GeneratesAssets>(method), "a method shows views, or it generates assets");
  AssetRequest wish;
  wish.count = 2;
  wish.steps = 2;
  std::vector<float> all;
  for (const NewAsset& asset : as<GeneratesAssets>(method)->generate(wish))
    all.insert(all.end(), asset.code.begin(), asset.code.end());
  return all;
}

std::unique_ptr<Method> with_data(std::unique_ptr<Method> method, const Worlds& worlds) {
  load_world(*method, worlds);
  return method;
}

void check_evaluation(Method& method, const Worlds& worlds) {
  auto* renders = as<RendersViews>(method);
  if (!renders) {
    const PriorScore score = as<GeneratesAssets>(method)->score();
    CHECK(std::isfinite(score.v_loss));
    return;
  }
  const Scene& scene = worlds.scene_of(method);
  const Pixels& pixels = worlds.pixels_of(method);
  const Baselines baselines(scene, pixels);
  const std::vector<ImageScore> scores = evaluate(*renders, {0, scene, pixels, baselines});
  REQUIRE(scores.size() == pixels.frames.size());
  for (const ImageScore& score : scores) CHECK(std::isfinite(score.psnr));
}

void check_method(const Make& make, const Worlds& worlds) {
  const auto whole = [&] { return with_data(make(), worlds); };
  const auto show = [&](Method& method) { return look(method, worlds); };
  check_resumes_from_every_step({whole, show, 4});
  const Folder folder;
  const auto method = whole();
  TrainOptions options;
  options.steps = 4;
  train({*method, folder.path, {}, nullptr, nullptr}, options, {});
  for (const float value : show(*method)) REQUIRE(std::isfinite(value));
  check_evaluation(*method, worlds);
}

std::unique_ptr<Method> image_field() {
  auto method = std::make_unique<ImageField>();
  Config config;
  method->configure(config);
  config.set("network.width", "16", "test");
  return method;
}

}  // namespace

TEST_CASE("every registered method is built, trained, saved, resumed, evaluated and looked at") {
  const Worlds worlds;
  for (const std::string& name : method_names()) {
    CAPTURE(name);
    check_method([&] { return configured(name, small_settings(name)); }, worlds);
  }
}

TEST_CASE("every method of streets does so on a log without boxes") {
  const Worlds worlds(std::vector<Actor>{});
  for (const std::string& name : method_names()) {
    if (!has<Street>(name)) continue;
    CAPTURE(name);
    check_method([&] { return configured(name, small_settings(name)); }, worlds);
  }
}

TEST_CASE("the method of CONTRIBUTING.md does what every method does, and learns its image") {
  const Worlds worlds;
  check_method(image_field, worlds);
  const auto method = with_data(image_field(), worlds);
  const Folder folder;
  TrainOptions options;
  options.steps = 300;
  train({*method, folder.path, {}, nullptr, nullptr}, options, {});
  const Figure psnr = method->step({301, 300, 1}, {}).figures.front();
  CHECK(psnr.value() > worlds.mean_colour_psnr() + 6);
}
