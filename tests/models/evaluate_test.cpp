// Masks, guesses and LiDAR errors of logs, against what can be said by hand.
#include "models/eval/evaluate.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "models/data/camera_file.h"
#include "models/data/pandaset.h"
#include "models/data/turned_log.h"
#include "models/data/write_pandaset.h"
#include "models/eval/lidar_scores.h"
#include "models/eval/report.h"
#include "models/io/bytes.h"
#include "models/io/commit.h"
#include "models/io/image.h"
#include "models/io/ply.h"
#include "models/metrics/feature_distance.h"
#include "runtime/error.h"
#include "tests/models/folder.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

Eigen::Matrix4d at(double x, double y, double z) {
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  pose.topRightCorner<3, 1>() = Eigen::Vector3d(x, y, z);
  return pose;
}

/// One camera that looks along the world's z at the origin, one frame a step; frame i shows grey of value i.
struct GreyLog {
  Scene scene;
  Pixels train, test;
  GreyLog(const std::vector<int>& training, const std::vector<int>& tests) {
    scene.is_log = true;
    scene.cameras = {{4, 2, 4, 4, 2, 1, CameraModel::pinhole, {}, 0, 0}};
    train.cameras = test.cameras = scene.cameras;
    for (const int step : training) add(step, Split::train, train);
    for (const int step : tests) add(step, Split::test, test);
  }
  void add(int step, Split split, Pixels& pixels) {
    Frame frame;
    frame.image = "camera/front_camera/" + std::to_string(step) + ".png";
    frame.sensor = "front_camera";
    frame.step = step;
    frame.timestamp = 0.1 * step;
    frame.split = split;
    std::vector<std::uint8_t> rgba(4 * 8, static_cast<std::uint8_t>(step));
    for (std::size_t i = 3; i < rgba.size(); i += 4) rgba[i] = 255;
    pixels.frames.push_back({scene.frames.size(), 0, 4, 2, rgba, {}});
    scene.frames.push_back(frame);
  }
};

/// Decibel of a difference of so many 255ths everywhere.
double decibel(double levels) { return -20 * std::log10(levels / 255); }

BaselineScores guesses_of(const GreyLog& log, const ActorMask* mask = nullptr) {
  const std::vector<float> rgb(24, static_cast<float>(log.test.frames[0].rgba[0]) / 255);
  return Baselines(log.scene, log.train).score({log.scene, log.test.frames[0], rgb, mask});
}

/// A wall at a distance, which every ray meets.
struct Wall final : Street {
  float distance;
  explicit Wall(float metres) : distance(metres) {}
  LidarReturns measure(const WorldRays& rays) override {
    return {std::vector<float>(rays.directions.size() / 3, distance), std::vector<int>(rays.directions.size() / 3, 0)};
  }
  Picture render_asset(const AssetName&, const Camera&, const Eigen::Matrix4d&) override { return {}; }
};

/// Every view is of stripes.
struct Stripes final : RendersViews {
  Picture render(const View& view) override {
    const int w = view.camera.width, h = view.camera.height;
    Picture picture{w, h, {}, {}, {}, {}};
    for (int i = 0; i < 3 * w * h; ++i) picture.rgb.push_back(i / 3 % w % 4 < 2 ? 0.2f : 0.7f);
    return picture;
  }
};

}  // namespace

TEST_CASE("copies and blends are of the neighbouring training photos of the same camera") {
  const BaselineScores scores = guesses_of(GreyLog({10, 20, 40, 100}, {34}));
  CHECK(scores.copy == doctest::Approx(decibel(6)));                         // 40 is nearer than 20
  CHECK(scores.blend == doctest::Approx(decibel(4)));                        // (20 + 40) / 2 = 30
  CHECK(scores.mean_colour == doctest::Approx(decibel(8.5)).epsilon(1e-3));  // 170 / 4 = 42.5
  CHECK(std::isnan(scores.nearest_frame));
  const BaselineScores tie = guesses_of(GreyLog({20, 40}, {30}));
  CHECK(tie.copy == doctest::Approx(decibel(10)));  // the earlier, as far away as the later
  CHECK(tie.blend > 100);
  const BaselineScores first = guesses_of(GreyLog({20, 40}, {15}));
  CHECK(first.blend == doctest::Approx(decibel(5)));  // nothing before it: the one after
  GreyLog other({20, 40}, {30});
  other.scene.frames[2].sensor = "left_camera";
  CHECK(std::isnan(guesses_of(other).blend));
}

TEST_CASE("each actor is painted in its own true mean colour, and rows in their mean colours of training") {
  GreyLog log({20, 40}, {30});
  log.scene.actors.resize(2);
  ActorMask mask{4, 2, {1, 1, 2, 2, 0, 0, 0, 0}};
  std::vector<float> rgb(24, 0.f);
  const float values[] = {0.1f, 0.3f, 0.8f, 0.8f};  // actor 1 differs by 0.1 from its mean, actor 2 not at all
  for (std::size_t i = 0; i < 12; ++i) rgb[i] = values[i / 3];
  const BaselineScores scores = Baselines(log.scene, log.train).score({log.scene, log.test.frames[0], rgb, &mask});
  CHECK(scores.mean_masked == doctest::Approx(-10 * std::log10(0.5 * 0.01)).epsilon(1e-4));
  mask.actors = {0, 0, 2, 2, 0, 0, 0, 0};  // of one colour: its own mean is no guess
  CHECK(std::isnan(Baselines(log.scene, log.train).score({log.scene, log.test.frames[0], rgb, &mask}).mean_masked));
  for (FramePixels& frame : log.train.frames)
    for (std::size_t i = 0; i < 32; ++i) frame.rgba[i] = i % 4 == 3 ? 255 : i < 16 ? 100 : 200;
  for (std::size_t i = 0; i < 24; ++i) rgb[i] = (i < 12 ? 110.f : 210.f) / 255;
  const BaselineScores rows = Baselines(log.scene, log.train).score({log.scene, log.test.frames[0], rgb, nullptr});
  CHECK(rows.row_mean == doctest::Approx(decibel(10)).epsilon(1e-4));
}

TEST_CASE("guesses of moving actors are over those that go further than a metre, whatever the source calls them") {
  GreyLog log({20, 40}, {30});
  const auto on_way = [](const char* id, bool stationary, const std::vector<double>& places) {
    Actor actor{id, "Car", {2, 4, 2}, stationary, {}};
    for (const double x : places) actor.boxes.push_back({static_cast<int>(actor.boxes.size()), 0, at(x, 0.8, 0)});
    return actor;
  };
  log.scene.actors = {on_way("drives", false, {0, 0.5, 1.1}), on_way("sways", false, {0, 0.9, -0.9}),
                      on_way("goes and returns", true, {5, 9, 5}), on_way("is never there", false, {})};
  const ActorMask mask{4, 2, {1, 1, 2, 2, 0, 0, 3, 0}};
  CHECK(mask.moving(log.scene) == std::vector<std::uint8_t>{255, 255, 0, 0, 0, 0, 255, 0});
  std::vector<float> rgb;
  for (const int level : {48, 52, 100, 104, 30, 30, 26, 30}) rgb.insert(rgb.end(), 3, static_cast<float>(level) / 255);
  const BaselineScores scores = Baselines(log.scene, log.train).score({log.scene, log.test.frames[0], rgb, &mask});
  const auto decibel_of = [](double levels_squared) { return decibel(std::sqrt(levels_squared)); };
  CHECK(scores.copy_moving == doctest::Approx(decibel_of((28 * 28 + 32 * 32 + 6 * 6) / 3.0)));   // 20 everywhere
  CHECK(scores.blend_moving == doctest::Approx(decibel_of((18 * 18 + 22 * 22 + 4 * 4) / 3.0)));  // 30
  CHECK(scores.mean_moving == doctest::Approx(decibel_of((2 * 2 + 2 * 2) / 3.0)).epsilon(1e-4));
  CHECK(scores.blend_masked == doctest::Approx(decibel_of((18 * 18 + 22 * 22 + 70 * 70 + 74 * 74 + 4 * 4) / 5.0)));
  log.scene.actors.resize(2);
  const ActorMask parked{4, 2, {2, 2, 2, 2, 0, 0, 0, 0}};
  CHECK(std::isnan(Baselines(log.scene, log.train).score({log.scene, log.test.frames[0], rgb, &parked}).blend_moving));
}

TEST_CASE("moving_psnr of a render is over the actors that go somewhere, and is reported for each log") {
  GreyLog log({0}, {90});
  log.scene.cameras = {{30, 10, 30, 30, 15, 5, CameraModel::pinhole, {}, 0, 0}};
  log.test.cameras = log.scene.cameras;
  FramePixels& photo = log.test.frames[0];
  photo.width = 30, photo.height = 10;
  photo.rgba.assign(4 * 300, 255);  // left half 204, right half 255
  for (std::size_t i = 0; i < 300; ++i)
    for (std::size_t c = 0; c < 3; ++c) photo.rgba[4 * i + c] = i % 30 < 15 ? 204 : 255;
  log.scene.actors = {{"drives", "Car", {1, 1, 1}, false, {{0, 0.0, at(-4, 0, 5.5)}, {90, 9.0, at(-1, 0, 5.5)}}},
                      {"parks", "Car", {1, 1, 1}, false, {{0, 0.0, at(1, 0, 5.5)}, {90, 9.0, at(1, 0, 5.5)}}}};
  struct Grey final : RendersViews {
    Picture render(const View&) override { return {30, 10, std::vector<float>(900, 0.7f), {}, {}, {}}; }
  } method;
  const ActorMasks masks(log.scene);
  const Baselines baselines(log.scene, log.train);
  const ImageScore score = evaluate(method, {0, log.scene, log.test, baselines, &masks}).at(0);
  CHECK(score.moving_psnr == doctest::Approx(20).epsilon(1e-5));  // 0.1 beside 0.8
  CHECK(score.masked_psnr == doctest::Approx(-10 * std::log10((0.01 + 0.09) / 2)).epsilon(1e-5));
  EvalResult result;
  result.is_log = true;
  result.scenes = {{"log", {score}, {}, 0}};
  CHECK(to_json(result).at("moving_psnr") == score.moving_psnr);
  CHECK(to_json(result).at("logs").at(0).at("moving_psnr") == score.moving_psnr);
}

TEST_CASE("masks of truth: actors with a box at that step, most pixels of a block") {
  const Folder folder;
  Scene log;
  log.root = folder.path;
  log.is_log = true;
  log.actors = {{"car", "Car", {2, 4, 2}, false, {{3, 0.3, at(0, 0, 0)}}}, {"bus", "Bus", {2, 4, 2}, false, {}}};
  Frame frame;
  frame.image = "camera/front_camera/03.jpg";
  frame.step = 3;
  fs::create_directories(folder.path / "truth" / "front_camera");
  commit_text(folder.path / "truth" / "actors.json", R"({"7": "car", "8": "bus", "9": "far away"})");
  // Blocks of 2x2: three pixels of four; two (not most); the bus, which has no box; the unknown and the far one.
  const std::vector<std::uint8_t> numbers = {7, 7, 7, 7, 8, 8, 5, 9,  //
                                             7, 0, 0, 0, 8, 8, 9, 9};
  write_png(folder.path / "truth" / "front_camera" / "03_actor.png", {8, 2, 1, numbers});
  const ActorMasks masks(log);
  CHECK(masks.has_truth(frame));
  const Camera half{4, 1, 4, 4, 2, 0.5, CameraModel::pinhole, {}, 0, 0};
  CHECK(masks.of(frame, half).actors == std::vector<int>{1, 0, 0, 0});
  frame.step = 4;
  CHECK(masks.of(frame, half).actors == std::vector<int>{0, 0, 0, 0});
  frame.image = "camera/front_camera/04.jpg";  // has no truth: the outline of the box, if it has one at that step
  CHECK_FALSE(masks.has_truth(frame));
  CHECK(masks.of(frame, half).actors == std::vector<int>{0, 0, 0, 0});
  frame.step = 3;
  frame.timestamp = 0.3;
  CHECK(masks.of(frame, half).actors == std::vector<int>{1, 1, 1, 1});
  commit_text(folder.path / "truth" / "actors.json", R"({"seven": "car"})");
  CHECK_THROWS_AS(ActorMasks{log}, Error);
}

TEST_CASE("without truth a box's outline stands for its actor, the nearer in front") {
  Scene log;
  log.is_log = true;
  Actor near{"near", "Car", {1, 1, 1}, false, {{0, 0, at(0, 0, 5.5)}}}, far{"far", "Car", {4, 1, 1}, false, {}};
  far.boxes = {{0, 0, at(0, 0, 9.5)}};
  const Actor behind{"behind", "Car", {9, 9, 1}, false, {{0, 0, at(0, 0, -5)}}};
  log.actors = {far, near, behind};
  Frame frame;
  frame.timestamp = 0;
  const Camera camera{30, 10, 30, 30, 15, 5, CameraModel::pinhole, {}, 0, 0};
  const ActorMasks masks(log);
  CHECK_FALSE(masks.has_truth(frame));
  const ActorMask mask = masks.of(frame, camera);
  // The near face at 5 m spans 0.5 / 5 * 30 = 3 pixels each way; the far one at 9 m 2 / 9 * 30 = 6.7.
  const std::vector<int> row(mask.actors.begin() + 4 * 30, mask.actors.begin() + 5 * 30);
  CHECK(std::count(row.begin(), row.end(), 2) == 6);
  CHECK(row[12] == 2);
  CHECK(row[11] == 1);
  CHECK(std::count(row.begin(), row.end(), 1) == 14 - 6);
  CHECK(std::count(mask.actors.begin(), mask.actors.end(), 3) == 0);
}

TEST_CASE("actors turn counter-clockwise about their own z axes") {
  Scene log;
  log.root = "nowhere";
  log.actors = {{"a", "Car", {2, 4, 2}, false, {{0, 0, at(3, 1, 0)}}}};
  GreyLog grey({0, 1}, {2});
  log.frames = grey.scene.frames;
  const TurnedLog turned = turned_log(log, 90);
  const Eigen::Matrix4d pose = turned.scene.actors[0].boxes[0].world_from_box;
  CHECK((pose.topRightCorner<3, 1>() - Eigen::Vector3d(3, 1, 0)).norm() < 1e-12);
  CHECK((pose.topLeftCorner<3, 3>() * Eigen::Vector3d::UnitY() + Eigen::Vector3d::UnitX()).norm() < 1e-12);
  CHECK_FALSE(turned.has_truth);
  CHECK(frames_of(turned.scene, Split::test).size() == 3);
  CHECK(turned.scene.frames[1].image == "camera/front_camera/1.png");
}

TEST_CASE("of turned actors those images are measured that there are") {
  const Folder folder;
  Scene log;
  GreyLog grey({0, 1}, {2});
  log.frames = grey.scene.frames;
  log.root = folder.path;
  fs::create_directories(folder.path / "truth/rot090/front_camera");
  CHECK_FALSE(has_turned_truth(log));  // a folder alone
  commit_text(folder.path / "truth/rot090/front_camera" / fs::path(log.frames[1].image).filename(), "");
  CHECK(has_turned_truth(log));
  const TurnedLog turned = turned_log(log, 90), other = turned_log(log, 135), recorded = turned_log(log, 0);
  CHECK(turned.has_truth);
  CHECK(turned.possible == 3);
  CHECK(frames_of(turned.scene, Split::test) == std::vector<std::size_t>{1});
  CHECK(turned.scene.frames[1].image == "truth/rot090/front_camera/1.png");
  CHECK(other.has_truth);
  CHECK(other.possible == 3);
  CHECK(frames_of(other.scene, Split::test).empty());
  // As recorded: the camera's own image of the one moment that another angle has, once that is on the disk.
  CHECK(frames_of(recorded.scene, Split::test).empty());
  fs::create_directories((folder.path / log.frames[1].image).parent_path());
  for (const Frame& frame : log.frames) commit_text(folder.path / frame.image, "");
  const TurnedLog as_recorded = turned_log(log, 0);
  CHECK(as_recorded.has_truth);
  CHECK(frames_of(as_recorded.scene, Split::test) == std::vector<std::size_t>{1});
  CHECK(as_recorded.scene.frames[1].image == log.frames[1].image);
}

TEST_CASE("what a camera would see from inside of a turned actor is not measured") {
  Scene log;
  log.root = "nowhere";
  GreyLog grey({0, 1}, {2});
  log.frames = grey.scene.frames;
  const Eigen::Vector3d camera = log.frames[0].world_from_camera.topRightCorner<3, 1>();
  // A lorry of 10 m by 2 m, 3 m beside the camera.
  log.actors = {{"a", "Truck", {2, 10, 4}, false, {{0, 0, at(camera.x() + 3, camera.y(), camera.z())}}}};
  log.actors[0].boxes[0].timestamp = *log.frames[0].timestamp;
  CHECK(turned_log(log, 180).scene.frames[0].split == Split::test);
  CHECK(turned_log(log, 90).scene.frames[0].split == Split::unused);
  log.actors[0].size.y() = 5.4;  // 0.3 m away from the camera when it is turned
  CHECK(turned_log(log, 90).scene.frames[0].split == Split::test);
  log.actors[0].size.y() = 5.8;
  CHECK(turned_log(log, 90).scene.frames[0].split == Split::unused);
}

TEST_CASE("distances by networks are of the whole picture, and of the actors with all else black") {
  GreyLog log({0}, {90});
  log.scene.cameras = {{16, 12, 10, 10, 8, 6, CameraModel::pinhole, {}, 0, 0}};
  log.test.cameras = log.scene.cameras;
  FramePixels& photo = log.test.frames[0];
  photo.width = 16, photo.height = 12;
  photo.rgba.assign(4 * 16 * 12, 255);
  for (std::size_t i = 0; i < photo.rgba.size(); i += 4) photo.rgba[i] = static_cast<std::uint8_t>(i % 251);
  log.scene.actors = {{"a", "Car", {2, 2, 2}, false, {{90, 9.0, at(0, 0, 6)}}}};
  const ActorMasks masks(log.scene);
  const ActorMask mask = masks.of(log.scene.frames[1], log.scene.cameras[0]);
  const auto seen = std::count(mask.actors.begin(), mask.actors.end(), 1);
  REQUIRE((seen > 4 && seen < 100));

  const FeatureNetwork network = random_features();
  Tensors weights;
  for (const int64_t channels : {16, 32, 64, 64}) weights.push_back(random_uniform({1, channels, 1, 1}, {5}));
  const Lpips metric{"lpips-alex-v0.1", network, weights};
  Stripes method;
  EvaluateOptions options;
  options.features = &network, options.lpips = &metric;
  std::vector<float> truth, rendered;
  options.seen = [&](const EvaluatedImage& image) { truth = image.truth, rendered = image.picture.rgb; };
  const Baselines baselines(log.scene, log.train);
  const ImageScore score = evaluate(method, {0, log.scene, log.test, baselines, &masks}, options).at(0);
  const auto black = [&](const std::vector<float>& rgb) { return as_batch(on_black(rgb, mask.any()), 16, 12); };
  const Tensor ours = as_batch(rendered, 16, 12), photos = as_batch(truth, 16, 12);
  CHECK(score.lpips == double{metric(ours, photos).item()});
  CHECK(score.masked_lpips == double{metric(black(rendered), black(truth)).item()});
  CHECK(score.feature_distance == double{feature_distance(network, ours, photos).item()});
  CHECK(score.masked_feature_distance == double{feature_distance(network, black(rendered), black(truth)).item()});
  CHECK(score.masked_lpips < score.lpips);
  CHECK(score.lpips > 1.01 * score.masked_lpips);

  EvalResult result;
  result.is_log = true;
  result.scenes = {{"log", {score}, {{1, 2}, {3, 5}}, 0}};
  result.perceptual = "lpips-alex-v0.1";
  const auto known = to_json(result);
  CHECK(known.at("lpips") == score.lpips);
  CHECK(known.at("masked_lpips") == score.masked_lpips);
  CHECK(known.at("perceptual_network") == "lpips-alex-v0.1");
  CHECK(known.at("logs").at(0).at("masked_ssim") == score.masked_ssim);
  CHECK(known.at("lidar_median_error_m") == 1.5);
  CHECK(known.at("lidar_chamfer_m2") == 4);
  CHECK(known.at("logs").at(0).at("lidar_chamfer_m2") == 4);
  result.perceptual = "lpips-alex-v0.1, unverified weights";
  const auto unknown = to_json(result);
  CHECK_FALSE(unknown.contains("lpips"));
  CHECK_FALSE(unknown.contains("masked_lpips"));
  CHECK(unknown.at("perceptual_distance") == score.lpips);
  CHECK(unknown.at("masked_perceptual_distance") == score.masked_lpips);
}

TEST_CASE("outlines of actors are compared with true masks, and with no others") {
  const Folder folder;
  GreyLog log({0}, {90});
  log.scene.root = folder.path;
  log.scene.cameras = {{40, 30, 30, 30, 20, 15, CameraModel::pinhole, {}, 0, 0}};
  log.test.cameras = log.scene.cameras;
  FramePixels& photo = log.test.frames[0];
  photo.width = 40, photo.height = 30;
  photo.rgba.assign(4 * 40 * 30, 255);
  // The face of its box, 5 m away, covers columns 14 to 25 and rows 9 to 20.
  log.scene.actors = {{"car", "Car", {2, 2, 2}, false, {{90, 9.0, at(0, 0, 6)}}}};
  struct Shifted final : RendersViews {
    Picture render(const View&) override {
      Picture picture{40, 30, std::vector<float>(3600, 0.5f), {}, {}, {}};
      for (int i = 0; i < 1200; ++i)
        picture.actors.push_back(i % 40 >= 17 && i % 40 < 29 && i / 40 >= 9 && i / 40 < 21 ? 1 : 0);
      return picture;
    }
  } method;
  const Baselines baselines(log.scene, log.train);
  const auto score = [&] {
    const ActorMasks masks(log.scene);
    return evaluate(method, {0, log.scene, log.test, baselines, &masks}).at(0);
  };
  CHECK(std::isnan(score().overlap));
  CHECK(std::isnan(score().box_overlap));
  std::vector<std::uint8_t> numbers(1200);
  for (std::size_t i = 0; i < 1200; ++i) numbers[i] = i % 40 >= 20 && i % 40 < 32 && i / 40 >= 9 && i / 40 < 21 ? 7 : 0;
  fs::create_directories(folder.path / "truth/front_camera");
  commit_text(folder.path / "truth/actors.json", R"({"7": "car"})");
  write_png(folder.path / "truth/front_camera/90_actor.png", {40, 30, 1, numbers});
  CHECK(score().overlap == doctest::Approx(9. / 15));      // three of twelve columns beside it
  CHECK(score().box_overlap == doctest::Approx(6. / 18));  // six
}

TEST_CASE("LiDAR errors and Chamfer distances are of the test sweeps, along rays from the LiDAR") {
  const Folder folder;
  Scene log;
  log.root = folder.path;
  log.is_log = true;
  log.cameras = {{4, 4, 4, 4, 2, 2, CameraModel::pinhole, {}, 0, 0}};
  for (int step = 0; step < 2; ++step) log.sweeps.push_back({"", 0.1 * step, at(1, 0, 0), step, Split::train});
  const auto image = [](const Frame&) { return Image{4, 4, 3, std::vector<std::uint8_t>(48, 0)}; };
  // Seen from (1, 0, 0): 4, 6 and 10 m away; the last is of the other LiDAR.
  const auto points = [](const Sweep&) {
    return LidarPoints{{5, 0, 0, 1, 6, 0, 1, 0, 10, 1, 99, 0}, {0, 0, 0, 0}, {0, 0, 0, 0}, {0, 0, 0, 1}, 0};
  };
  write_pandaset(folder.path, log, {image, points});
  for (Sweep& sweep : log.sweeps) sweep.file = "lidar/" + pandaset_number(sweep.step) + ".pkl.gz";
  log.sweeps[1].split = Split::test;
  Wall wall(7);
  const Listener silent = {[](const std::string&) {}, [](const std::string&) {}, [](const auto&) {}};
  const LidarScores scores = lidar_scores(wall, log, 0, alone(), silent);
  REQUIRE(scores.errors.size() == 3);
  CHECK(scores.errors[0] == doctest::Approx(3));
  CHECK(scores.errors[1] == doctest::Approx(1));
  CHECK(scores.median_error() == doctest::Approx(3));
  CHECK(LidarScores{{4, 1, 2, 3}, {}}.median_error() == doctest::Approx(2.5));
  log.sweeps[1].second_lidar = {0, 0, 2};  // now its place is known, too
  const LidarScores both = lidar_scores(wall, log, 0, alone(), silent);
  REQUIRE(both.errors.size() == 4);
  CHECK(both.errors[3] == doctest::Approx(std::hypot(99, 2) - 7));
  log.sweeps[1].second_lidar.reset();
  // The wall is 7 m away: each point's nearest is that of its own ray, 3, 1 and 3 m away, from either side.
  REQUIRE(scores.chamfer.size() == 1);
  CHECK(scores.chamfer[0] == doctest::Approx(2 * (9 + 1 + 9) / 3.0));
  LidarScores two = scores;
  two.add({{}, {1}});
  CHECK(two.mean_chamfer() == doctest::Approx((38 / 3.0 + 1) / 2));
  CHECK(std::isnan(LidarScores{}.mean_chamfer()));
  Wall nothing(0);
  CHECK(std::isinf(lidar_scores(nothing, log, 0, alone(), silent).mean_chamfer()));
  SweepRays many;
  for (int i = 0; i < 10; ++i) many.depths.push_back(static_cast<float>(i));
  many.rays.origins.assign(30, 0), many.rays.directions.assign(30, 0);
  CHECK(thinned(many, 4).depths == std::vector<float>{0, 3, 6, 9});
}

TEST_CASE("what renders write is read back: 16-bit labels, points, and a camera's time and log") {
  const Folder folder;
  write_labels(folder.path / "few.png", {2, 1, {0, 255}});
  write_labels(folder.path / "many.png", {2, 1, {256, 65535}});
  CHECK(read_labels(folder.path / "few.png").values == std::vector<std::uint16_t>{0, 255});
  CHECK(read_labels(folder.path / "many.png").values == std::vector<std::uint16_t>{256, 65535});

  write_ply_vertices(folder.path / "points.ply", {{"x", {1.5f, -2}}, {"actor", {0, 3}}});
  const PlyVertices points = read_ply_vertices(folder.path / "points.ply");
  CHECK(points.column("x") == std::vector<float>{1.5f, -2});
  CHECK(points.column("actor") == std::vector<float>{0, 3});

  const std::string pose = R"("transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]])";
  commit_text(folder.path / "cameras.json", R"({"w": 4, "h": 2, "fl_x": 4, "time": 1.5, "frames": [{)" + pose +
                                                R"(}, {"log": "007", "time": 2.5, )" + pose + R"(}, {"log": 0, )" +
                                                pose + "}]}");
  const std::vector<View> views = read_camera_file(folder.path / "cameras.json", {"003", "007"}, 1);
  REQUIRE(views.size() == 3);
  CHECK((views[0].scene == 1 && views[0].time == 1.5));
  CHECK((views[1].scene == 1 && views[1].time == 2.5));
  CHECK((views[2].scene == 0 && views[2].time == 1.5));
  CHECK_THROWS_AS(read_camera_file(folder.path / "cameras.json", {"003"}), Error);
}
