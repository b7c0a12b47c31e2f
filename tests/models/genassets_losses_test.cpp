// The losses of GenAssets' first stage, by closed forms and by one another.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

#include "models/io/commit.h"
#include "models/io/image.h"
#include "models/methods/genassets.h"
#include "tests/models/folder.h"
#include "tests/models/toy_genassets.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// An actor mask beside the image of a frame: actor 1 where `shows` says so of a column and a row.
void write_silhouette(const Scene& scene, size_t frame, const std::function<bool(int, int)>& shows) {
  const Camera& camera = scene.cameras[0];
  Image mask{camera.width, camera.height, 1, {}};
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) mask.pixels.push_back(shows(x, y) ? 1 : 0);
  fs::create_directories(scene.root / "truth");
  commit_text(scene.root / "truth" / "actors.json", "{\"1\": \"" + scene.actors.at(0).id + "\"}");
  write_png(scene.root / (std::to_string(frame) + "_actor.png"), mask);
}

}  // namespace

TEST_CASE("genassets: a whole image in tiles has the gradients of one patch that covers it") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 1, .width = 32, .height = 32});
  scene.actors = {toy_actor("a", {2, 4, 1.5}, 12, 2), toy_actor("b", {2, 4, 2.5}, 14, -2)};
  write_silhouette(scene, 0, [](int x, int y) { return x > 5 && x + y < 27; });
  const auto gradients = [&](const Settings& more) {
    Settings settings = {{"batch.lidar_rays", "0"},
                         {"weight.kl", "1e-3"},
                         {"weight.silhouette", "0.5"},
                         {"batch.patches", "1"},
                         {"batch.patch_side", "16"}};
    settings.insert(settings.end(), more.begin(), more.end());
    const auto method = loaded(scene, settings);
    fill(*method, -0.05f);
    Tensors wanted;
    for (const auto& [name, p] : method->parameters()) wanted.push_back(p);
    const Step all = method->step({1, 100, 1}, wanted);
    CHECK(figure(all, "actors") == 2);
    std::map<std::string, std::vector<float>> out;
    size_t at = 0;
    for (const auto& [name, p] : method->parameters())
      if (const Tensor& g = all.gradients[at++]) out[name] = g.to_host();
    return out;
  };
  const auto want = gradients({});
  CHECK(want.size() > 30);
  for (const char* side : {"96", "8"}) {
    CAPTURE(std::string(side));
    const auto got = gradients({{"batch.whole_images", "true"}, {"batch.tile_side", side}});
    CHECK(got.size() == want.size());
    for (const auto& [name, values] : want) {
      CAPTURE(name);
      REQUIRE(got.contains(name));
      double most = 0, apart = 0;
      for (size_t i = 0; i < values.size(); ++i) {
        most = std::max(most, std::abs(double{values[i]}));
        apart = std::max(apart, std::abs(double{values[i]} - double{got.at(name)[i]}));
      }
      CHECK(apart <= 2e-4 * most + 1e-8);
    }
  }
}

TEST_CASE("genassets: the silhouette loss is the squared distance to the masks, and shapes actors by them") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 2, .width = 32, .height = 32});
  scene.actors = {toy_actor("a", {2, 6, 3}, 10, 0)};
  write_silhouette(scene, 0, [](int x, int y) { return x < 16 && (x > 0 || y % 2 == 0); });
  const Settings alone = {{"weight.silhouette", "2"}, {"weight.rgb", "0"},           {"weight.kl", "0"},
                          {"batch.lidar_rays", "0"},  {"weight.line_of_sight", "0"}, {"batch.patches", "1"},
                          {"batch.patch_side", "16"}, {"batch.object_side", "32"}};
  // Empty space. Of 16 columns of cells, the actor has 7 and three quarters of an eighth; of frame 1 no mask says so.
  const auto empty = loaded(scene, alone);
  fill(*empty, 10);
  int known = 0;
  for (int64_t step = 1; step <= 12; ++step) {
    const float loss = empty->step({step, 100, 1}, {}).loss.item();
    if (loss != 0) CHECK(loss == doctest::Approx(2 * (7 + 0.75 * 0.75) / 16).epsilon(1e-3));
    known += loss != 0;
  }
  CHECK((known > 1 && known < 11));

  const auto method = loaded(scene, alone, 0);
  fill(*method);
  const View view = view_of(scene.frames[0], scene.cameras[0], 0);
  const Middle box = middle_of(as<RendersViews>(*method)->render(view), 1);
  CHECK(box.x == doctest::Approx(16).epsilon(0.05));
  TrainOptions options;
  options.steps = 100;
  train({*method, folder.path / "run", {}, nullptr, nullptr}, options, {});
  const Picture after = as<RendersViews>(*method)->render(view);
  int right = 0;
  for (size_t i = 0; i < after.actors.size(); ++i) right += after.actors[i] == 1 && i % 32 >= 18;
  CHECK(middle_of(after, 1).pixels > box.pixels / 3);
  CHECK(right < box.pixels / 20);

  fs::remove(folder.path / "0_actor.png");
  CHECK_THROWS_WITH_AS(loaded(scene, alone), doctest::Contains("no training image has an actor mask"), Error);
}

TEST_CASE(
    "genassets: the KL term is that of normal distributions, summed over a code and averaged over the actors met") {
  const Folder folder;
  Scene scene = toy_street(folder.path);
  scene.actors = {toy_actor("a", {2, 4, 1.5}, 12, 2), toy_actor("b", {2, 4, 1.5}, 12, -2)};
  const auto method =
      loaded(scene, {{"weight.kl", "1"}, {"weight.rgb", "0"}, {"weight.lidar", "0"}, {"weight.line_of_sight", "0"}});
  const int64_t numbers = 4 * 4 * 4;
  std::vector<float> codes;
  double want = 0;
  for (int64_t i = 0; i < 2 * 2 * numbers; ++i) {
    codes.push_back(0.7f * std::sin(static_cast<float>(3 * i)));
    const bool variance = i / numbers % 2 == 1;
    const double value = double{codes.back()}, log_variance = value - 6;
    want += 0.5 / 2 * (variance ? std::exp(log_variance) - 1 - log_variance : value * value);
  }
  put(*method, "log0.codes", codes);
  const Step step = method->step({1, 100, 1}, {});
  REQUIRE(figure(step, "actors") == 2);
  CHECK(double{step.loss.item()} == doctest::Approx(want).epsilon(1e-5));
}

TEST_CASE("genassets: pixels that a mask leaves out change neither loss nor gradients") {
  const Folder folder;
  const Scene scene = crossing(folder.path, 4);
  for (const char* whole : {"false", "true"}) {
    CAPTURE(whole);
    const auto step_with = [&](bool masked, int below) {
      const Settings settings = {{"batch.whole_images", whole},   {"weight.perceptual", "0.1"},
                                 {"weight.adversarial", "0.001"}, {"perceptual.weights", ""},
                                 {"batch.objects", "1"},          {"batch.object_side", "32"},
                                 {"adversarial.widths", "8,8,8"}};
      const auto method = built(scene, settings);
      Pixels pixels = toy_pixels(scene);
      for (FramePixels& photo : pixels.frames) {
        if (masked) photo.mask.assign(photo.rgba.size() / 4, 255);
        for (size_t i = 0; i < photo.rgba.size() / 4; ++i) {
          if (i % static_cast<size_t>(photo.width) < 20) continue;
          if (masked) photo.mask[i] = 0;
          for (size_t c = 0; c < 3; ++c)
            photo.rgba[4 * i + c] = static_cast<uint8_t>((photo.rgba[4 * i + c] + below) % 256);
        }
      }
      load_data(*method, scene, std::move(pixels));
      const Tensors wanted = {method->parameters().at("log0.codes"),
                              method->parameters().at("networks.field.past.weight")};
      const Step step = method->step({1, 100, 1}, wanted);
      std::vector<std::vector<float>> out = {{step.loss.item()}};
      for (const Tensor& gradient : step.gradients) out.push_back(gradient.to_host());
      return out;
    };
    const auto one = step_with(true, 0);
    CHECK(one == step_with(true, 90));
    CHECK(one != step_with(false, 0));
    for (size_t i = 1; i < one.size(); ++i)
      CHECK(std::any_of(one[i].begin(), one[i].end(), [](float value) { return value != 0; }));
  }
}

TEST_CASE("genassets: where all pixels are left out, images teach nothing") {
  const Folder folder;
  const Scene scene = crossing(folder.path, 4);
  for (const char* whole : {"false", "true"}) {
    CAPTURE(whole);
    const auto method = built(scene, {{"batch.whole_images", whole},
                                      {"weight.perceptual", "0.1"},
                                      {"batch.object_side", "32"},
                                      {"weight.lidar", "0"},
                                      {"weight.line_of_sight", "0"},
                                      {"weight.kl", "0"}});
    Pixels pixels = toy_pixels(scene);
    for (FramePixels& photo : pixels.frames) photo.mask.assign(photo.rgba.size() / 4, 0);
    load_data(*method, scene, std::move(pixels));
    const Step step = method->step({1, 100, 1}, {method->parameters().at("networks.image.leave.weight")});
    CHECK(step.loss.item() == 0);
    const std::vector<float> gradient = step.gradients[0].to_host();
    CHECK(std::all_of(gradient.begin(), gradient.end(), [](float value) { return value == 0; }));
  }
}

TEST_CASE("genassets: of one image the background learns nothing behind actors while codes come up") {
  const Folder folder;
  Scene scene = toy_street(folder.path);
  scene.actors = {toy_actor("wide", {2, 40, 40}, 12, 0)};
  for (ActorBox& box : scene.actors[0].boxes) box.world_from_box = toy_pose(12, 0, 0);  // every ray meets it
  const auto slope = [&](std::optional<size_t> only, int64_t step, const char* whole = "false") {
    const auto method =
        loaded(scene, {{"batch.lidar_rays", "0"}, {"batch.whole_images", whole}, {"networks.frozen", "true"}}, only);
    TensorMap networks;
    for (const auto& [name, p] : method->parameters()) networks[name] = named(p);
    as<SharesNetworks>(*method)->adopt_networks(networks);
    const Step all = method->step({step, 1000, 1}, {method->parameters().at("log0.background")});
    const std::vector<float> g = all.gradients[0].to_host();
    return std::abs(*std::max_element(g.begin(), g.end(), [](float a, float b) { return std::abs(a) < std::abs(b); }));
  };
  CHECK(slope(0, 1) == 0);
  CHECK(slope(0, 1, "true") == 0);
  CHECK(slope(0, 300) > 0);
  CHECK(slope(0, 300, "true") > 0);
  CHECK(slope({}, 1) > 0);
}
