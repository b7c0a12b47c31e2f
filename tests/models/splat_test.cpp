// Training of gaussians on a small scene made for the test.
#include <doctest/doctest.h>

#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/io/checkpoint.h"
#include "models/metrics/psnr.h"
#include "models/synth/synthetic_scene.h"
#include "models/train/trainer.h"
#include "runtime/error.h"
#include "tests/models/folder.h"
#include "tests/models/made_method.h"
#include "tests/models/mean_colour.h"
#include "tests/models/resume.h"

using namespace cloam;

namespace {

struct Capture {
  Folder folder;
  Scene scene;
  Capture() {
    write_synthetic_scene(folder.path / "data", {16, 3, 40, 3});
    scene = read_scene(folder.path / "data");
  }
};

std::unique_ptr<Method> built(const Scene& scene, const Settings& settings, Pixels photos) {
  auto method = configured("splat", settings);
  method->build({scene}, 7);
  load_data(*method, scene, std::move(photos));
  return method;
}

std::unique_ptr<Method> built(const Scene& scene, const Settings& settings) {
  return built(scene, settings, load_images(scene, Split::train));
}

double test_psnr(Method& method, const Scene& scene) {
  const Pixels test = load_images(scene, Split::test);
  double sum = 0;
  for (const FramePixels& frame : test.frames)
    sum +=
        psnr(shown(method, view_of(scene.frames[frame.frame], test.cameras[static_cast<size_t>(frame.camera)], 0)).rgb,
             on_white(frame));
  return sum / static_cast<double>(test.frames.size());
}

/// Test PSNR after so many steps.
double trained(const Capture& capture, const Settings& settings, int64_t steps) {
  const auto method = built(capture.scene, settings);
  TrainOptions options;
  options.steps = steps;
  train({*method, capture.folder.path / "ckpt", {}, nullptr, nullptr}, options, {});
  return test_psnr(*method, capture.scene);
}

}  // namespace

TEST_CASE("splat: growth from few gaussians is worth its while, with either strategy") {
  const Capture capture;
  const Settings few = {{"initial", "random"}, {"initial.random", "150"}};
  const auto with = [&](Settings more) {
    more.insert(more.end(), few.begin(), few.end());
    return trained(capture, more, 600);
  };
  const double still = with({{"growth.start", "100000"}});
  const double densified = with({{"growth.start", "60"}, {"growth.every", "30"}});
  const double mcmc =
      with({{"growth.strategy", "mcmc"}, {"growth.start", "60"}, {"growth.every", "10"}, {"growth.max", "1500"}});
  const double baseline = mean_colour_figure(capture.scene);
  MESSAGE("PSNR: mean colour ", baseline, ", 150 gaussians ", still, ", densified ", densified, ", mcmc ", mcmc);
  CHECK(still > baseline + 3);
  CHECK(densified > still + 1.5);
  CHECK(mcmc > still + 1.5);
}

TEST_CASE("splat: a checkpoint of any step holds all that the next step and a render read, growth and all") {
  const Folder folder;
  write_synthetic_scene(folder.path / "data", {6, 1, 24, 3});
  const Scene scene = read_scene(folder.path / "data");
  const Settings densify = {{"initial", "random"},  {"initial.random", "200"},   {"growth.start", "20"},
                            {"growth.every", "20"}, {"growth.gradient", "1e-5"}, {"growth.reset_every", "50"},
                            {"exposure", "true"},   {"background", "random"},    {"sh.every", "10"}};
  const Settings mcmc = {{"initial", "random"},
                         {"initial.random", "200"},
                         {"growth.strategy", "mcmc"},
                         {"growth.start", "20"},
                         {"growth.every", "20"}};
  for (const Settings& settings : {densify, mcmc}) {
    CAPTURE(settings[2].first);
    check_resumes_from_every_step({[&] { return built(scene, settings); },
                                   [&](Method& method) {
                                     std::vector<float> look =
                                         shown(method, view_of(scene.frames.front(), scene.cameras.front(), 0)).rgb;
                                     look.push_back(static_cast<float>(method.parameters().at("opacities").dim(0)));
                                     return look;
                                   }});
  }
}

TEST_CASE("splat: what exposures differ in stays out of the model") {
  const Capture capture;
  Scene scene = capture.scene;
  scene.has_alpha = false;
  const auto on_black = [](FramePixels& frame, double light) {
    for (size_t i = 0; i < frame.rgba.size(); i += 4) {
      for (size_t c = 0; c < 3; c++)
        frame.rgba[i + c] = static_cast<uint8_t>(frame.rgba[i + c] * (frame.rgba[i + 3] / 255.0) * light);
      frame.rgba[i + 3] = 255;
    }
  };
  double gain = 0;  // of the dark photos less that of the others, learned
  const auto psnr_with = [&](const char* exposure) {
    Pixels photos = load_images(scene, Split::train);
    // Half of them at half the light: what the model shows is their mean, as logarithms.
    for (size_t i = 0; i < photos.frames.size(); i++) on_black(photos.frames[i], i % 2 == 0 ? 0.5 : 1);
    const auto method =
        built(scene, {{"initial", "random"}, {"initial.random", "400"}, {"exposure", exposure}}, std::move(photos));
    TrainOptions options;
    options.steps = 500;
    train({*method, capture.folder.path / exposure, {}, nullptr, nullptr}, options, {});
    if (method->parameters().contains("exposure")) {
      const std::vector<float> learned = method->parameters().at("exposure").to_host();
      for (size_t i = 0; i < learned.size(); i++)
        if (i % 6 < 3) gain += (i / 6 % 2 == 0 ? 1 : -1) * double{learned[i]} / static_cast<double>(learned.size() / 4);
    }
    Pixels test = load_images(scene, Split::test);
    double sum = 0;
    for (FramePixels& frame : test.frames) {
      on_black(frame, std::sqrt(0.5));
      std::vector<float> truth;
      for (size_t i = 0; i < frame.rgba.size(); i++)
        if (i % 4 < 3) truth.push_back(static_cast<float>(frame.rgba[i]) / 255.f);
      const Camera& camera = test.cameras[static_cast<size_t>(frame.camera)];
      sum += psnr(shown(*method, view_of(scene.frames[frame.frame], camera, 0)).rgb, truth);
    }
    return sum / static_cast<double>(test.frames.size());
  };
  const double without = psnr_with("false"), with = psnr_with("true");
  MESSAGE("PSNR: ", without, ", with exposures ", with, "; gain ", gain, " of ", -std::log(2));
  CHECK(with > without + 0.7);
  CHECK(gain < -0.5 * std::log(2));  // the offset takes a part
}

TEST_CASE("splat: a growth with nothing to do changes nothing") {
  const Capture capture;
  CHECK(trained(capture,
                {{"initial", "random"},
                 {"initial.random", "150"},
                 {"growth.strategy", "mcmc"},
                 {"growth.start", "5"},
                 {"growth.every", "5"},
                 {"growth.max", "150"}},
                20) > mean_colour_figure(capture.scene));
}

TEST_CASE("splat: settings that cannot be are told") {
  const Capture capture;
  CHECK_THROWS_AS(built(capture.scene, {{"initial", "points"}}), Error);  // the capture has none
  CHECK_THROWS_AS(built(capture.scene, {{"initial", "nowhere"}}), Error);
  CHECK_THROWS_AS(built(capture.scene, {{"growth.strategy", "none"}}), Error);
  CHECK_THROWS_AS(built(capture.scene, {{"sh.degree", "4"}}), Error);
  CHECK_THROWS_WITH_AS(built(capture.scene, {{"background", "pink"}}), doctest::Contains("background: \"pink"), Error);
}
