// Figures of single actors, against what can be said by hand.
#include "models/eval/actor_figures.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <numbers>

#include "models/eval/report.h"
#include "models/io/commit.h"
#include "models/io/image.h"
#include "tests/models/folder.h"

using namespace cloam;

namespace {

/// World from the box of an actor that is turned about the world's y, which points down.
Eigen::Matrix4d placed(double x, double z, double degrees) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translate(Eigen::Vector3d(x, 0, z));
  pose.rotate(Eigen::AngleAxisd(degrees * std::numbers::pi / 180, Eigen::Vector3d::UnitY()));
  return pose.matrix();
}

/// A camera at the origin that looks along z; steps 0 and 1 train, step 2 is measured. A car straight ahead turns by 30
/// degrees a step; a van comes with the last step.
struct TurningLog {
  Scene scene;
  Pixels train, test;
  TurningLog() {
    scene.is_log = true;
    scene.cameras = {{80, 40, 60, 60, 40, 20, CameraModel::pinhole, {}, 0, 0}};
    train.cameras = test.cameras = scene.cameras;
    for (const int step : {0, 1, 2}) {
      Frame frame;
      frame.image = "camera/front_camera/0" + std::to_string(step) + ".png";
      frame.step = step;
      frame.timestamp = 0.1 * step;
      (step < 2 ? train : test)
          .frames.push_back({scene.frames.size(), 0, 80, 40, std::vector<uint8_t>(4 * 3200, 255), {}});
      scene.frames.push_back(frame);
    }
    Actor car{"car", "Car", {2, 2, 2}, false, {}}, van{"van", "Van", {2, 2, 2}, false, {}};
    for (const int step : {0, 1, 2}) car.boxes.push_back({step, 0.1 * step, placed(0, 10, 30.0 * step)});
    van.boxes.push_back({2, 0.2, placed(-5, 10, 0)});
    scene.actors = {car, van};
  }
};

}  // namespace

TEST_CASE("the view of an actor is as far from training views as the actor has turned since") {
  const TurningLog log;
  const TrainingViews views(log.scene, log.train);
  CHECK(views.degrees_to_nearest(log.scene.actors[0], log.scene.frames[2]) == doctest::Approx(30).epsilon(1e-9));
  CHECK(views.degrees_to_nearest(log.scene.actors[0], log.scene.frames[1]) == doctest::Approx(0));
  CHECK(std::isnan(views.degrees_to_nearest(log.scene.actors[1], log.scene.frames[2])));  // no photo shows the van
  CHECK(std::isnan(TrainingViews().degrees_to_nearest(log.scene.actors[0], log.scene.frames[2])));
}

TEST_CASE("an actor that stands beside the image gives no training view") {
  TurningLog log;
  for (ActorBox& box : log.scene.actors[0].boxes)
    box.world_from_box = placed(box.step == 1 ? 40 : 0, 10, 30.0 * box.step);
  const TrainingViews views(log.scene, log.train);
  CHECK(views.degrees_to_nearest(log.scene.actors[0], log.scene.frames[2]) == doctest::Approx(60).epsilon(1e-9));
}

TEST_CASE("actors moved aside are seen from another direction") {
  TurningLog log;
  const TrainingViews views(log.scene, log.train);
  log.scene.actors[0].boxes[2].world_from_box = placed(2, 10, 0);  // as at step 0, but 2 m to the right of it
  CHECK(views.degrees_to_nearest(log.scene.actors[0], log.scene.frames[2]) ==
        doctest::Approx(std::atan2(2, 10) * 180 / std::numbers::pi).epsilon(1e-9));
}

TEST_CASE("an actor's PSNR is over its own pixels, beside that of its mean colour") {
  const TurningLog log;
  ActorMask mask{80, 40, std::vector<int>(3200, 0)};
  std::vector<float> truth(3 * 3200, 0.25f), picture = truth;
  for (std::size_t i = 0; i < 32; ++i) {  // the car: black and white by turns, the picture 0.1 off
    mask.actors[i] = 1;
    for (std::size_t c = 0; c < 3; ++c) {
      truth[3 * i + c] = i % 2 == 0 ? 0.f : 1.f;
      picture[3 * i + c] = truth[3 * i + c] + (i % 2 == 0 ? 0.1f : -0.1f);
    }
  }
  for (std::size_t i = 100; i < 115; ++i) mask.actors[i] = 2;  // the van: a pixel too few
  const auto figures = actor_figures(picture, {log.scene, log.test.frames[0], truth, &mask}, {log.scene, log.train});
  REQUIRE(figures.size() == 1);
  CHECK(figures[0].actor == 0);
  CHECK(figures[0].pixels == 32);
  CHECK(figures[0].psnr == doctest::Approx(20).epsilon(1e-5));
  CHECK(figures[0].mean_psnr == doctest::Approx(-20 * std::log10(0.5)));
  CHECK(figures[0].view_degrees == doctest::Approx(30).epsilon(1e-9));
}

TEST_CASE("an actor of one colour has no mean colour to clear, and one that no photo shows no angle") {
  const TurningLog log;
  ActorMask mask{80, 40, std::vector<int>(3200, 0)};
  const std::vector<float> truth(3 * 3200, 0.3f), picture(3 * 3200, 0.4f);
  std::fill_n(mask.actors.begin(), 16, 2);  // the van
  const auto figures = actor_figures(picture, {log.scene, log.test.frames[0], truth, &mask}, {log.scene, log.train});
  REQUIRE(figures.size() == 1);
  CHECK(figures[0].psnr == doctest::Approx(20).epsilon(1e-4));
  CHECK(std::isnan(figures[0].mean_psnr));
  CHECK(std::isnan(figures[0].view_degrees));
}

TEST_CASE("what training photos show is told by masks of truth, also of photos whose size does not divide") {
  const Folder folder;
  TurningLog log;
  log.scene.root = folder.path;
  log.scene.cameras = {{1001, 501, 700, 700, 500, 250, CameraModel::pinhole, {}, 0, 0}};
  log.train.cameras = log.scene.cameras;
  for (FramePixels& photo : log.train.frames) photo.width = 1001, photo.height = 501;
  std::filesystem::create_directories(folder.path / "truth" / "front_camera");
  commit_text(folder.path / "truth" / "actors.json", R"({"7": "car"})");
  for (const int step : {0, 1}) {  // truth: the second photo does not show the car, though its box is in front of it
    std::vector<std::uint8_t> numbers(1001 * 501, 0);
    for (std::size_t i = 0; i < 60 && step == 0; ++i) std::fill_n(&numbers[(200 + i) * 1001 + 400], 60, 7);
    write_png(folder.path / "truth" / "front_camera" / ("0" + std::to_string(step) + "_actor.png"),
              {1001, 501, 1, numbers});
  }
  const TrainingViews views(log.scene, log.train);
  CHECK(views.degrees_to_nearest(log.scene.actors[0], log.scene.frames[2]) == doctest::Approx(60).epsilon(1e-9));
}

TEST_CASE("per_actor.csv quotes ids, and has the angle that an actor was turned by") {
  const Folder folder;
  EvalResult result;
  result.is_log = true;
  result.protocol = "rotate360";
  SceneResult scene{"log", {}, {}, 0};
  scene.actors = {{"a \"1\", b", "Car", true}};
  ImageScore image;
  image.name = "truth/rot045/front_camera/00.jpg";
  image.degrees = 45;
  image.actors = {{0, 20, 25.5, kNoScore, 3}};
  scene.images = {image};
  result.scenes = {scene};
  write_reports(folder.path, result);
  std::ifstream file(folder.path / "per_actor.csv");
  const std::string csv{std::istreambuf_iterator<char>(file), {}};
  CHECK(csv ==
        "log,image,degrees,actor,label,moves,pixels,psnr,baseline_mean_psnr,view_degrees\n"
        "\"log\",\"truth/rot045/front_camera/00.jpg\",45,\"a \"\"1\"\", b\",\"Car\",1,20,25.5,nan,3\n");
}
