// Boxes that are learned: how they accelerate, against difference quotients on the host, and the log that is written.
#include <doctest/doctest.h>

#include <cmath>

#include "models/data/data_frame.h"
#include "models/data/refined_log.h"
#include "models/methods/street_gaussians_model.h"
#include "models/scene/pose.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

/// A car that turns and brakes; its boxes come at uneven times, and one is missing.
Actor braking_car() {
  Actor car{"a", "Car", {2, 4, 1.5}, false, {}};
  for (const int step : {0, 1, 2, 3, 5, 6, 7}) {
    const double t = 0.1 * step + 0.01 * std::sin(7.0 * step);
    car.boxes.push_back(
        {step, t, pose_from(turn_about_z(0.4 * t), {500 + 8 * t - 1.5 * t * t, 0.7 * t * t, 0.2 * std::sin(3 * t)})});
  }
  return car;
}

/// Over the boxes with one before and one behind them: the mean square, from places in double precision.
double mean_square_acceleration(const Actor& car) {
  double total = 0;
  int count = 0;
  for (std::size_t b = 1; b + 1 < car.boxes.size(); ++b) {
    const ActorBox &first = car.boxes[b - 1], &second = car.boxes[b], &third = car.boxes[b + 1];
    if (third.step != first.step + 2) continue;
    const auto place = [](const ActorBox& box) { return Vector3d(box.world_from_box.topRightCorner<3, 1>()); };
    const Vector3d before = (place(second) - place(first)) / (second.timestamp - first.timestamp),
                   after = (place(third) - place(second)) / (third.timestamp - second.timestamp);
    total += ((after - before) / ((third.timestamp - first.timestamp) / 2)).squaredNorm();
    ++count;
  }
  return total / count;
}

}  // namespace

TEST_CASE("boxes' accelerations are those of the places to which shifts and turns move them") {
  Scene scene;
  scene.is_log = true;
  scene.actors = {braking_car()};
  StreetGaussiansConfig config;
  config.sky_side = 1;
  Params parameters;
  const StreetGaussiansModel model(config, parameters, scene);
  CHECK(model.square_accelerations().item() ==
        doctest::Approx(mean_square_acceleration(scene.actors[0])).epsilon(1e-4));

  std::vector<float> shifts, yaws;
  for (int i = 0; i < 7; ++i) {
    for (int k = 0; k < 3; ++k) shifts.push_back(static_cast<float>(0.3 * std::sin(5 * i + 2 * k)));
    yaws.push_back(static_cast<float>(0.05 * i));
  }
  assign({{parameters.at(kPositionsName), from_host(shifts, {7, 3})},
          {parameters.at(kYawsName), from_host(yaws, {7, 1})}});
  const std::vector<Actor> learned = model.refined_actors();
  REQUIRE(learned.size() == 1);
  for (std::size_t b = 0; b < 7; ++b) {
    const Eigen::Matrix4d &given = scene.actors[0].boxes[b].world_from_box, &moved = learned[0].boxes[b].world_from_box;
    const Vector3d by(shifts[3 * b], shifts[3 * b + 1], shifts[3 * b + 2]);
    const double yaw = std::atan2(given(1, 0), given(0, 0)), turned = std::atan2(moved(1, 0), moved(0, 0));
    CHECK(turned == doctest::Approx(yaw + yaws[b]));
    const Vector3d place(given(0, 3) + std::cos(yaw) * by.x() - std::sin(yaw) * by.y(),
                         given(1, 3) + std::sin(yaw) * by.x() + std::cos(yaw) * by.y(), given(2, 3) + by.z());
    CHECK((moved.topRightCorner<3, 1>() - place).norm() < 1e-6);
  }
  CHECK(model.square_accelerations().item() == doctest::Approx(mean_square_acceleration(learned[0])).epsilon(1e-4));
  double length = 0;
  for (std::size_t b = 0; b < 7; ++b) length += std::hypot(shifts[3 * b], shifts[3 * b + 1], shifts[3 * b + 2]) / 7;
  CHECK(model.mean_shift().item() == doctest::Approx(length));
}

TEST_CASE("a log is written with learned boxes: what was not learned stays, byte for byte or value for value") {
  const Folder folder;
  Scene log;
  log.root = folder.path / "given";
  log.format = "PandaSet";
  write_text(folder.path / "elsewhere/00.jpg", "not looked at");
  std::filesystem::create_directories(log.root / "camera");
  std::filesystem::create_directory_symlink(folder.path / "elsewhere", log.root / "camera/front_camera");
  const auto cuboids = [&](const char* name) {
    DataFrame frame;
    frame.add({"uuid", std::vector<std::string>{"a", "b"}});
    frame.add({"yaw", std::vector<double>{0.5, -0.5}});
    for (const char* axis : {"position.x", "position.y", "position.z"}) frame.add({axis, std::vector<double>{1, 2}});
    frame.add({"attributes.rider_status", std::vector<std::string>{"-", "With Rider"}});
    write_data_frame(log.root / "annotations/cuboids" / name, frame);
  };
  cuboids("00.pkl.gz");
  cuboids("01.pkl.gz");
  Actor actor{"b", "Bicycle", {1, 2, 1}, false, {{1, 0.1, pose_from(turn_about_z(0.25), {7, 8, 9})}}};
  write_refined_log(folder.path / "refined", log, {{actor}});

  const std::filesystem::path refined = folder.path / "refined";
  CHECK(content_of(refined / "camera/front_camera/00.jpg") == "not looked at");
  const char* const untouched = "annotations/cuboids/00.pkl.gz";
  CHECK(content_of(refined / untouched) == content_of(log.root / untouched));
  const DataFrame moved = read_data_frame(refined / "annotations/cuboids/01.pkl.gz");
  CHECK(moved.numbers("position.x") == std::vector<double>{1, 7});
  CHECK(moved.numbers("position.y") == std::vector<double>{1, 8});
  CHECK(moved.numbers("position.z") == std::vector<double>{1, 9});
  CHECK(moved.numbers("yaw")[0] == 0.5);
  CHECK(moved.numbers("yaw")[1] == doctest::Approx(0.25));
  CHECK(moved.texts("attributes.rider_status")[1] == "With Rider");

  log.format = "KITTI";
  const auto write_other = [&] { write_refined_log(folder.path / "other", log, {{actor}}); };
  CHECK(holds(error_of(write_other, Fault::usage), "only those of PandaSet's layout"));
  CHECK_FALSE(std::filesystem::exists(folder.path / "other"));
}
