// NeuRAD on streets of a few boxes: what it can be held to without long training.
#include "models/methods/neurad.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "models/fields/neurad_field.h"
#include "models/methods/registry.h"
#include "models/train/trainer.h"
#include "runtime/ops.h"
#include "tests/models/resume.h"
#include "tests/models/toy_genassets.h"
#include "tests/models/worlds.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

std::unique_ptr<Method> loaded_neurad(const Scene& scene, const Settings& more = {}) {
  Settings settings = small_settings("neurad");
  settings.insert(settings.end(), more.begin(), more.end());
  auto method = configured("neurad", settings);
  method->build({scene}, 1);
  load_data(*method, scene, toy_pixels(scene));
  return method;
}

/// Matter wherever samples are: actors fill their boxes, the background its voxels.
void fill_all(Method& method, float distance = -1) {
  std::vector<float> bias = method.parameters().at("field.past.bias").to_host();
  bias[0] = distance;
  put(method, "field.past.bias", bias);
}

/// The largest gradient of a part of a parameter after one step's loss.
double gradient_in(Method& method, const std::string& name, size_t begin, size_t end) {
  const Step all = method.step({1, 100, 1}, {method.parameters().at(name)});
  const std::vector<float> g = all.gradients[0].to_host();
  double most = 0;
  for (size_t i = begin; i < end; ++i) most = std::max(most, std::abs(double{g[i]}));
  return most;
}

}  // namespace

TEST_CASE("neurad: levels of a grid count as much as a sample of that width leaves of them") {
  NeuradFieldOptions options;
  options.background = {3, 2, 10, 4, 64};
  options.actors = {1, 2, 6, 4, 4};
  Params params;
  const Scope root{params, "", 3};
  const NeuradField field(root / "b", root / "a", root / "f", options, 2);
  const std::vector<float> widths = {0, 0.05f, 1.f};
  const Tensor point = from_host(std::vector<float>{.3f, .6f, .2f, .3f, .6f, .2f, .3f, .6f, .2f}, {3, 3});
  const Tensor owners = from_host(std::vector<int32_t>{1, 0, 1}, {3});
  const std::vector<float> seen =
      field.encoded({point, from_host(widths, {3}), {}}, {point, zeros({3}), owners}).to_host();
  const std::vector<double> cells = {4, 16, 64};
  for (size_t s = 0; s < 3; ++s)
    for (size_t c = 0; c < 6; ++c) {
      CAPTURE(s);
      CAPTURE(c);
      const double kept = std::min(1., 1 / (2 * double{widths[s]} * cells[c / 2] + 1e-12));
      CHECK(double{seen[6 * s + c]} == doctest::Approx(kept * double{seen[c]}).epsilon(1e-4));
    }
  // Of actors: one level, zeros in place of the others; each owner has rows of its own.
  for (size_t c = 2; c < 6; ++c) CHECK(seen[6 * 3 + c] == 0);
  CHECK(seen[6 * 3] == seen[6 * 5]);
  CHECK(seen[6 * 3] != seen[6 * 4]);
}

TEST_CASE("neurad: the preset has the paper's sizes") {
  const Preset& preset = find_preset("neurad");
  Settings settings(preset.settings.begin(), preset.settings.end());
  // Tables of 2^22 rows are as wide as these, but longer.
  settings.insert(settings.end(), {{"grid.log2_rows", "6"}, {"actors.log2_rows", "6"}, {"weight.perceptual", "0"}});
  const Folder folder;
  Scene scene = toy_street(folder.path);
  scene.actors = {toy_actor("a", {2, 4, 1.5}, 12, 0), toy_actor("b", {2, 4, 1.5}, 12, 4)};
  const auto method = configured("neurad", settings);
  method->build({scene}, 1);
  const auto count = [&](const std::string& name) { return method->parameters().at(name).numel(); };
  CHECK(count("background.table") == 8 * 64 * 4);
  CHECK(count("actors.table") == 2 * 4 * 64 * 4);
  CHECK(count("appearance") == 2 * 16 * 2);  // camera and LiDAR, at the log's first second and the next
  int64_t network = 0;
  for (const auto& [name, p] : method->parameters())
    if (name.starts_with("field.distance.")) network += p.numel();
  CHECK(network == 3 * 32 * 32);
}

TEST_CASE("neurad: an actor's outline is that of its box, and moves with it by as many pixels") {
  const Folder folder;
  const Camera camera{96, 72, 90, 90, 48, 36};
  std::vector<Middle> seen;
  for (const double y : {-0.5, 0.5}) {
    Scene scene = toy_street(folder.path);
    scene.actors = {toy_actor("other", {1, 1, 1}, 20, 6), toy_actor("moved", {0.5, 2, 1.6}, 12, y)};
    const auto method = loaded_neurad(scene, {{"image.upsamplings", "0"}, {"steps.actor", "0.05"}});
    fill_all(*method);
    seen.push_back(middle_of(shown(*method, {camera, toy_camera_pose(0), 0, 0.3}), 2));
  }
  CHECK(seen[0].pixels > 100);
  CHECK(std::abs(seen[1].x - seen[0].x + 90. / 12) < 1);  // y points left in the picture
  CHECK(std::abs(seen[1].y - seen[0].y) < 1);
}

TEST_CASE("neurad: what a LiDAR would measure") {
  const Folder folder;
  Scene scene = toy_street(folder.path);
  scene.actors = toy_targets();
  const auto method = loaded_neurad(
      scene, {{"space.voxel", "0.25"}, {"space.dilate", "0"}, {"steps.background", "0.1"}, {"steps.actor", "0.05"}});
  fill_all(*method);
  check_toy_returns(*method);
}

TEST_CASE("neurad: a hidden actor's rows of the table learn nothing, the one's before it do") {
  const Folder folder;
  Scene scene = toy_street(folder.path);
  scene.actors = {toy_actor("before", {2, 12, 8}, 12, 0), toy_actor("hidden", {1, 1, 1}, 20, 0)};
  const auto method = loaded_neurad(scene, {{"actors.levels", "1"}, {"batch.lidar_rays", "0"}});
  fill_all(*method);
  const auto half = static_cast<size_t>(method->parameters().at("actors.table").numel() / 2);
  CHECK(gradient_in(*method, "actors.table", 0, half) > 1e-7);
  CHECK(gradient_in(*method, "actors.table", half, 2 * half) == 0);
}

TEST_CASE("neurad: an actor wears the looks of another of its log") {
  const Folder folder;
  Scene scene = toy_street(folder.path);
  scene.actors = {toy_actor("a", {2, 4, 1.5}, 12, 0), toy_actor("b", {2, 4, 1.5}, 14, 3)};
  const auto method = loaded_neurad(scene);
  fill_all(*method);
  std::vector<float> table = method->parameters().at("actors.table").to_host();
  for (size_t i = 0; i < table.size(); ++i) table[i] = std::sin(static_cast<float>(i));  // looks that differ
  put(*method, "actors.table", table);
  const View view{scene.cameras[0], toy_camera_pose(0), 0, 0.1};
  const std::vector<float> own = shown(*method, view).rgb;
  std::swap(scene.actors[0].asset, scene.actors[1].asset);
  as<TakesEdits>(*method)->take_actors({scene});
  CHECK(shown(*method, view).rgb == own);
  scene.actors[0].asset = AssetName{0, "b"};
  as<TakesEdits>(*method)->take_actors({scene});
  CHECK(shown(*method, view).rgb != own);
  scene.actors[0].asset = AssetName{0, "nobody"};
  as<TakesEdits>(*method)->take_actors({scene});
  CHECK_THROWS_AS(shown(*method, view), Error);
}

TEST_CASE("neurad: a sensor's embedding is linear between seconds, and a camera that the log lacks has the mean") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 2});
  scene.frames[1].sensor = "left_camera";
  scene.frames[1].timestamp = 2;
  Params params;
  NeuradOptions options;
  options.field.background = {2, 2, 6, 4, 8};
  options.field.actors = {1, 2, 6, 4, 4};
  const NeuradModel model(options, {params, "", 1}, scene);
  const auto row = [&](const std::string& sensor, double time) {
    return model.embedding_shares({{sensor, time}}).to_host();
  };
  CHECK(row("front_camera", 0.25) == std::vector<float>{0.75f, 0.25f, 0, 0, 0, 0, 0, 0, 0});
  CHECK(row("left_camera", 7) == std::vector<float>{0, 0, 0, 0, 0, 1, 0, 0, 0});
  CHECK(row(kLidarName, 1) == std::vector<float>{0, 0, 0, 0, 0, 0, 0, 1, 0});
  CHECK(row("", 1.5) == std::vector<float>{0, 0.25f, 0.25f, 0, 0.25f, 0.25f, 0, 0, 0});
}

TEST_CASE("neurad: learns a street's photos and where its wall is") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 3});
  scene.actors = {toy_actor("a", {2, 4, 1.5}, 12, 0)};
  const auto method = loaded_neurad(scene, {{"batch.lidar_rays", "128"}, {"train.warm_up", "10"}});
  fill_all(*method, -0.15f);  // the wall begins where its voxels do
  const Step before = method->step({1, 150, 1}, {});
  const double psnr = figure(before, "psnr"), metres = figure(before, "lidar_m");
  TrainOptions options;
  options.steps = 150;
  train({*method, folder.path / "run", {}, nullptr, nullptr}, options, {});
  const Step after = method->step({151, 150, 1}, {});
  CHECK(figure(after, "psnr") > psnr + 3);
  CHECK(metres > 0.35);
  CHECK(figure(after, "lidar_m") < 0.2);
}

namespace {

/// A camera that turns to the left about the world's z axis and drives ahead, 0.1 s from photo to photo.
Scene turning(const std::filesystem::path& root, double turn, double speed) {
  Scene scene = toy_street(root, {.frames = 4});
  scene.recording.shutter = 0.03;
  for (Frame& frame : scene.frames) {
    const double t = *frame.timestamp;
    const Eigen::Matrix3d by = Eigen::AngleAxisd(turn * t, Vector3d::UnitZ()).toRotationMatrix();
    frame.world_from_camera = toy_camera_pose(0);
    frame.world_from_camera.topLeftCorner<3, 3>() = by * frame.world_from_camera.topLeftCorner<3, 3>();
    frame.world_from_camera(0, 3) = speed * t;
  }
  return scene;
}

}  // namespace

TEST_CASE("a camera's motion during an exposure is that of its photos, also at the log's ends") {
  const Folder folder;
  const double turn = 0.8, speed = 12;
  const Scene scene = turning(folder.path, turn, speed);
  for (const double time : {0.0, 0.1, 0.17, 0.3}) {
    CAPTURE(time);
    const CameraMotion motion = camera_motion(scene, "front_camera", time);
    CHECK(motion.shutter == 0.03);
    CHECK(motion.seconds_after(0, 24) == doctest::Approx(-0.015));
    CHECK(motion.seconds_after(24, 24) == doctest::Approx(0.015));
    Eigen::Matrix4d pose = toy_camera_pose(0), later = pose;
    const auto turned = [&](double t) {
      return (Eigen::AngleAxisd(turn * t, Vector3d::UnitZ()).toRotationMatrix() * pose.topLeftCorner<3, 3>()).eval();
    };
    later.topLeftCorner<3, 3>() = turned(time + 0.015);
    later(0, 3) = speed * (time + 0.015);
    Eigen::Matrix4d now = pose;
    now.topLeftCorner<3, 3>() = turned(time);
    now(0, 3) = speed * time;
    const Eigen::Matrix4d found = now * motion.moved(0.015);
    CHECK((found.topLeftCorner<3, 3>() - later.topLeftCorner<3, 3>()).norm() < 1e-9);
    // At the ends the way lies in the chord of two photos: 0.015 s of it are off by a few millimetres.
    CHECK((found - later).norm() < (time > 0 && time < 0.3 ? 1e-3 : 1e-2));
  }
  CHECK(camera_motion(scene, "no_camera", 0.1).shutter == 0);
  Scene still = scene;
  still.recording.shutter = 0;
  CHECK(camera_motion(still, "front_camera", 0.1).shutter == 0);
}

TEST_CASE("neurad: rows of a picture see an actor where its box is when they are exposed") {
  const Folder folder;
  Scene scene = turning(folder.path, 0, 0);
  scene.actors = {toy_actor("a", {1, 1, 4}, 12, 0)};
  const double speed = 40;  // metres a second, to the left
  for (ActorBox& box : scene.actors[0].boxes) box.world_from_box(1, 3) = speed * (box.timestamp - 0.1);
  const Camera camera{96, 72, 90, 90, 48, 36};
  for (const char* rolling : {"true", "false"}) {
    const auto method = loaded_neurad(scene, {{"image.upsamplings", "0"}, {"sensors.rolling_shutter", rolling}});
    fill_all(*method);
    View view{camera, toy_camera_pose(0), 0, 0.1};
    view.sensor = "front_camera";
    const Picture picture = shown(*method, view);
    const auto middle_at = [&](int row) {
      double sum = 0, count = 0;
      for (int x = 0; x < camera.width; ++x)
        if (picture.actors[static_cast<size_t>(row * camera.width + x)] == 1) sum += x + 0.5, ++count;
      REQUIRE(count > 3);
      return sum / count;
    };
    const int high = 28, low = 44;  // rows
    const double metres = speed * 0.03 * (low - high) / camera.height;
    const double pixels = std::string(rolling) == "true" ? metres / 11.5 * camera.fx : 0;
    CHECK(std::abs(middle_at(high) - middle_at(low) - pixels) < 1);
  }
}
