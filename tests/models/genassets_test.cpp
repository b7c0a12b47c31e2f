// GenAssets' first stage on streets of a few boxes: what it can be held to without long training.
#include "models/methods/genassets.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <set>

#include "models/io/checkpoint.h"
#include "models/io/commit.h"
#include "models/io/image.h"
#include "models/io/tensors.h"
#include "models/methods/registry.h"
#include "models/scene/edit.h"
#include "models/scene/orbit.h"
#include "models/train/trainer.h"
#include "runtime/error.h"
#include "tests/models/folder.h"
#include "tests/models/resume.h"
#include "tests/models/toy_genassets.h"

using namespace cloam;
using Eigen::Vector3d;
namespace fs = std::filesystem;

namespace {

int64_t count_below(Method& method, const std::string& prefix) {
  int64_t count = 0;
  for (const auto& [name, p] : method.parameters())
    if (name.starts_with(prefix)) count += p.numel();
  return count;
}

/// The largest gradient of an actor's code (or planes) after one step's loss.
double reached(Method& method, size_t actor, int64_t step) {
  const char* name = method.parameters().contains("log0.codes") ? "log0.codes" : "log0.planes";
  const Tensor& assets = method.parameters().at(name);
  const Step all = method.step({step, 100, 1}, {assets});
  const std::vector<float> g = all.gradients[0].to_host();
  const auto row = g.begin() + static_cast<std::ptrdiff_t>(actor * g.size() / 2);
  double most = 0;
  for (auto at = row; at != row + static_cast<std::ptrdiff_t>(g.size() / 2); ++at)
    most = std::max(most, std::abs(double{*at}));
  return most;
}

bool all_finite(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

}  // namespace

TEST_CASE("genassets: the networks have the paper's sizes, and its faithful presets nothing else") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.lidar = false});
  scene.actors = {toy_actor("a", {2, 4, 1.5}, 12, 0)};
  for (const char* name : {"genassets", "genassets-faithful"}) {
    CAPTURE(name);
    const Preset& preset = find_preset(name);
    const auto method = built(scene, {{"weight.perceptual", "0"}, {"weight.adversarial", "0"}},
                              {preset.settings.begin(), preset.settings.end()});
    const int64_t not_the_papers =
        count_below(*method, "networks.decoder.past.") + count_below(*method, "networks.decoder.class_places");
    CHECK(static_cast<double>(count_below(*method, "networks.decoder.") - not_the_papers) ==
          doctest::Approx(4.9e6).epsilon(0.01));
    CHECK(static_cast<double>(count_below(*method, "networks.image.")) == doctest::Approx(0.33e6).epsilon(0.02));
    CHECK(count_below(*method, "log0.codes") == 2 * 8 * 8 * 32);  // mean and variance
    CHECK(count_below(*method, "log0.background") % (3 * 12) == 0);
    int64_t beyond = not_the_papers;
    for (const char* prefix : {"log0.common.", "networks.field.past."}) beyond += count_below(*method, prefix);
    CHECK((beyond == 0) == (std::string(name) == "genassets-faithful"));
  }
}

TEST_CASE("genassets: no gradient reaches a hidden actor") {
  const Folder folder;
  for (const char* decoder : {"false", "true"})
    for (const int64_t step : {2, 5}) {  // with and without leaving out what no light reaches
      CAPTURE(std::string(decoder));
      CAPTURE(step);
      const Settings settings = {{"decoder.use", decoder},
                                 {"shadows", "false"},
                                 {"weight.kl", "0"},
                                 {"code.variational", "false"},
                                 {"batch.lidar_rays", "0"}};
      const auto covered = loaded(crossing(folder.path, 0), settings);
      fill(*covered, -0.4f);
      CHECK(reached(*covered, 1, step) < 1e-6);
      CHECK(reached(*covered, 0, step) > 1e-5);
      CHECK(figure(covered->step({step, 100, 1}, {}), "actors") == 2);  // rays do meet the hidden one
      const auto open = loaded(crossing(folder.path, 6), settings);
      fill(*open, -0.4f);
      CHECK(reached(*open, 1, step) > 1e-5);
    }
}

TEST_CASE("genassets: masks are the boxes that the camera sees, and move with them") {
  const Folder folder;
  const Camera camera{96, 72, 90, 90, 48, 36};
  std::vector<Middle> seen;
  for (const double y : {-0.5, 0.5}) {
    Scene scene = toy_street(folder.path);
    scene.actors = {toy_actor("other", {1, 1, 1}, 20, 6), toy_actor("moved", {0.5, 2, 1.6}, 12, y)};
    for (ActorBox& box : scene.actors[1].boxes)
      box.world_from_box.topLeftCorner<3, 3>() = Eigen::AngleAxisd(0.5, Vector3d::UnitZ()).toRotationMatrix();
    const auto method = loaded(scene, {{"image.upsamplings", "0"}});
    fill(*method);
    const Picture picture = shown(*method, {camera, toy_camera_pose(0), 0, 0.3});
    seen.push_back(middle_of(picture, 2));
    CHECK(middle_of(picture, 1).pixels > 10);
    for (int row = 0; row < camera.height; ++row)
      for (int column = 0; column < camera.width; ++column) {
        CAPTURE(row);
        CAPTURE(column);
        const Vector3d way = toy_camera_pose(0).topLeftCorner<3, 3>() * direction(camera, {column + 0.5, row + 0.5});
        const auto [from, to] = within(scene.actors[1], toy_camera_pose(0).topRightCorner<3, 1>(), way.normalized());
        const auto at = static_cast<size_t>(row * camera.width + column);
        if (to < from) CHECK(picture.actors[at] != 2);
        if (to < from + 0.11) continue;  // no step may fall into it
        CHECK(picture.actors[at] == 2);
        CHECK(std::abs(double{picture.depth[at]} - from) < 0.2);
        CHECK(picture.opacity[at] > 0.99f);
      }
    CHECK(shown(*method, {camera, toy_camera_pose(0), 0, 5.0}).actors == std::vector<int>(96 * 72, 0));  // it has left
  }
  CHECK(seen[0].pixels > 100);
  CHECK(std::abs(seen[1].x - seen[0].x + 90. / 12) < 1);  // y points left in the picture
  CHECK(std::abs(seen[1].y - seen[0].y) < 1);
}

TEST_CASE("genassets: equal seeds give equal bytes, and a checkpoint of any step holds all that the next one reads") {
  const Folder folder;
  Scene scene = toy_street(folder.path);
  scene.actors = {toy_actor("a", {2, 4, 1.5}, 12, 0), toy_actor("b", {2, 2, 2}, 15, 3)};
  const auto made = [&](const char* whole) {
    auto method = loaded(scene, {{"weight.perceptual", "0.1"},
                                 {"weight.adversarial", "0.001"},
                                 {"weight.kl", "1e-3"},
                                 {"batch.whole_images", whole}});
    fill(*method, -0.1f);  // so that light reaches few samples, and what does so matters
    return method;
  };
  const auto look = [&](Method& method) { return shown(method, {scene.cameras[0], toy_camera_pose(0), 0, 0.05}).rgb; };
  const std::string want = content_of(train_to(*made("false"), folder.path / "a"));
  CHECK(want.size() > 1000);
  const auto again = made("false");
  CHECK(content_of(train_to(*again, folder.path / "b")) == want);
  CHECK(figure(again->step({6, 100, 1}, {}), "lit") < 0.7);
  check_resumes_from_every_step({[&] { return made("false"); }, look});
  check_resumes_from_every_step({[&] { return made("true"); }, look, 6});
}

TEST_CASE("genassets: what a LiDAR would measure") {
  const Folder folder;
  Scene scene = toy_street(folder.path);
  scene.actors = toy_targets();
  const auto method = loaded(scene, {{"space.voxel", "0.25"}, {"space.dilate", "0"}, {"steps.background", "0.1"}});
  fill(*method);
  check_toy_returns(*method);
}

// Adam's momentum moves whatever it steps: rows that a step's log does not own must not be stepped (spec: lazy Adam).
TEST_CASE("genassets: a step changes nothing of the logs that it does not see") {
  const Folder folder;
  Scenes scenes;
  for (const char* name : {"a", "b", "c"}) {
    fs::create_directories(folder.path / name);
    scenes.push_back(crossing(folder.path / name, 0));
  }
  const auto method = configured("genassets", kTiny);
  method->build(scenes, 1);
  std::vector<TrainingData> data;
  for (const Scene& scene : scenes) data.push_back({scene, toy_pixels(scene)});
  as<LearnsFromCaptures>(*method)->load_data(std::move(data));
  const auto bytes_of_logs = [&] {
    std::map<std::string, std::vector<std::vector<float>>> logs;
    for (const auto& [name, p] : method->parameters())
      if (name.starts_with("log")) logs[name.substr(0, 4)].push_back(p.to_host());
    return logs;
  };
  auto before = bytes_of_logs();
  REQUIRE(before.size() == 3);
  std::set<std::string> seen;
  TrainListener listener;
  listener.step = [&](const StepReport& report) {
    CAPTURE(report.progress.step);
    const auto now = bytes_of_logs();
    int changed = 0;
    for (const auto& [log, values] : now)
      if (values != before[log]) ++changed, seen.insert(log);
    CHECK(changed == 1);
    before = now;
  };
  TrainOptions options;
  options.steps = 12;
  train({*method, folder.path / "run", {}, nullptr, nullptr}, options, listener);
  CHECK(seen.size() == 3);
}

// Independent truth: what lies below a mask may be anything.
TEST_CASE("genassets: what a symmetric actor's left shows is its right, mirrored") {
  const Folder folder;
  Scene scene = toy_street(folder.path);
  scene.actors = {toy_actor("a", {2, 4, 1.5}, 12, 2)};
  const std::vector<float> right = {0.4f, 0.7f, 0.2f, 0.1f, -1.2f, -0.3f},
                           left = {-0.4f, 0.7f, 0.2f, -0.1f, -1.2f, -0.3f};
  for (const char* symmetric : {"true", "false"}) {
    const auto method = built(scene, {{"actors.symmetric", symmetric}});
    const auto distances = [&](const std::vector<float>& points) {
      return as<HasSurfaces>(*method)->sample_asset({0, "a"}, points).distances;
    };
    const std::vector<float> a = distances(right), b = distances(left);
    const float apart = std::max(std::abs(a[0] - b[0]), std::abs(a[1] - b[1]));
    CHECK((apart < 1e-5f) == (std::string(symmetric) == "true"));
  }
}

TEST_CASE("genassets: an actor that a step does not show stands still, momentum or not") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 6});
  scene.actors = {toy_actor("stays", {2, 4, 3}, 12, 0), toy_actor("leaves", {2, 3, 1.5}, 10, 2)};
  scene.actors[1].boxes.resize(3);
  for (const char* decoder : {"true", "false"}) {
    CAPTURE(std::string(decoder));
    const Settings settings = {{"decoder.use", decoder}};
    const std::string name = std::string(decoder) == "true" ? "log0.codes" : "log0.planes";
    const auto early = loaded(scene, settings, 0), late = loaded(scene, settings, 5);
    const std::vector<float> before = early->parameters().at(name).to_host();
    (void)train_to(*early, folder.path / decoder, 1);
    const SafetensorsFile saved = load_latest_checkpoint(folder.path / decoder).file;
    (void)train_to(*late, folder.path / decoder, 3, &saved);
    const std::vector<float> between = early->parameters().at(name).to_host(),
                             after = late->parameters().at(name).to_host();
    const auto same = [](const std::vector<float>& a, const std::vector<float>& b, size_t actor) {
      const size_t row = a.size() / 2;
      return std::memcmp(&a[actor * row], &b[actor * row], row * sizeof(float)) == 0;
    };
    CHECK_FALSE(same(before, between, 0));
    CHECK_FALSE(same(before, between, 1));
    CHECK_FALSE(same(between, after, 0));
    CHECK(same(between, after, 1));
  }
}

TEST_CASE("genassets: logs without actors, without LiDAR, and with boxes of no size train") {
  const Folder folder;
  const Scene empty = toy_street(folder.path);
  Scene no_lidar = toy_street(folder.path, {.frames = 1, .lidar = false});
  no_lidar.actors = {toy_actor("a", {2, 4, 1.5}, 12, 0)};
  Scene flat = toy_street(folder.path);
  flat.actors = {toy_actor("a", {0, 0, 0}, 12, 0)};
  int run = 0;
  for (const Scene& scene : {empty, no_lidar, flat}) {
    CAPTURE(run);
    const char* whole = run % 2 == 0 ? "true" : "false";
    const auto method =
        loaded(scene, {{"steps.background", "1"}, {"batch.whole_images", whole}, {"batch.tile_rays", "50"}});
    (void)train_to(*method, folder.path / std::to_string(run++), 2);
    const Picture picture = shown(*method, view_of(scene.frames[0], scene.cameras[0], 0));
    CHECK(picture.rgb.size() == 32 * 24 * 3);
    CHECK(all_finite(picture.rgb));
    CHECK(all_finite(picture.depth));
  }
}

TEST_CASE("genassets: adopted networks stand still, the log's own parameters do not") {
  const Folder folder;
  Scene scene = toy_street(folder.path);
  scene.actors = {toy_actor("a", {2, 6, 3}, 12, 0)};
  const Settings all = {{"weight.perceptual", "0.1"}, {"weight.adversarial", "0.001"}};
  (void)train_to(*loaded(scene, all), folder.path / "a", 2);
  const TensorMap networks = parameters_in(load_latest_checkpoint(folder.path / "a").file);
  Settings frozen = all;
  frozen.push_back({"networks.frozen", "true"});
  const auto method = loaded(scene, frozen);
  as<SharesNetworks>(*method)->adopt_networks(networks);
  std::map<std::string, std::vector<float>> before;
  for (const auto& [name, p] : method->parameters()) before[name] = p.to_host();
  const std::vector<float>& texels = before["log0.background"];  // begin in +-0.1 where networks learn, too
  CHECK(*std::max_element(texels.begin(), texels.end()) == doctest::Approx(0.01).epsilon(0.05));
  (void)train_to(*method, folder.path / "b", 1);
  int adopted = 0;
  for (const auto& [name, p] : method->parameters()) {
    CAPTURE(name);
    const bool network = name.starts_with("networks.");
    const std::vector<float> now = p.to_host();
    CHECK((now == before[name]) == network);
    if (!network) continue;
    const auto& bytes = networks.at(name).data;
    REQUIRE(bytes.size() == 4 * now.size());
    CHECK(std::memcmp(bytes.data(), now.data(), bytes.size()) == 0);
    adopted++;
  }
  CHECK(adopted > 20);
}

TEST_CASE("genassets: settings that no street can be made with are errors that name them") {
  const Folder folder;
  const Scene scene = toy_street(folder.path, {.lidar = false});
  const Settings bad = {{"steps.background", "0"}, {"steps.actor", "-1"},       {"space.voxel", "1e-9"},
                        {"steps.sky", "0"},        {"image.upsamplings", "-1"}, {"decoder.widths", "8,x"},
                        {"batch.tile_rays", "0"},  {"batch.patches", "0"},      {"batch.patch_side", "-3"}};
  for (const auto& [key, value] : bad) {
    CAPTURE(std::string(key));
    try {
      (void)built(scene, {{key, value}});
      FAIL("no error");
    } catch (const Error& error) {
      CHECK(error.fault() == Fault::usage);
      CHECK(std::string(error.what()).find(key) != std::string::npos);
    }
  }
  Scene photos = scene;
  photos.is_log = false;
  CHECK_THROWS_AS((void)built(photos), Error);
  const auto method = built(scene);
  CHECK_THROWS_AS(load_data(*method, scene, {}), Error);
}
