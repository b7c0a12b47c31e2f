// A path through cameras: where it goes, how it turns, and in which order.
#include "models/scene/camera_path.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <cmath>

using namespace cloam;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

Frame stop(const Vector3d& position, double degrees, double time) {
  Frame frame;
  const Vector3d axis = Vector3d(1, 2, -1).normalized();
  frame.world_from_camera.topLeftCorner<3, 3>() = Eigen::AngleAxisd(degrees * EIGEN_PI / 180, axis).toRotationMatrix();
  frame.world_from_camera.topRightCorner<3, 1>() = position;
  frame.timestamp = time;
  return frame;
}

std::vector<Frame> row(const std::vector<double>& places) {
  std::vector<Frame> stops;
  for (const double x : places) stops.push_back(stop({x, 0, 0}, 0, 0));
  return stops;
}

Matrix3d turn(const CameraMoment& moment) { return moment.world_from_camera.topLeftCorner<3, 3>(); }

std::vector<std::string> images(const std::vector<Frame>& frames) {
  std::vector<std::string> names;
  for (const Frame& frame : frames) names.push_back(frame.image);
  return names;
}

}  // namespace

TEST_CASE("a path goes through all cameras, and on its way turns evenly by rotations") {
  const std::vector<double> degrees = {0, 40, 200, 170, 350};  // the shorter way is 40, 160, -30, 180
  const std::vector<Frame> stops = {stop({0, 0, 0}, degrees[0], 5), stop({1, 3, 0}, degrees[1], 6),
                                    stop({1, 3, 4}, degrees[2], 8), stop({-9, 0, 1}, degrees[3], 8.5),
                                    stop({2, 2, 2}, degrees[4], 9)};
  const std::vector<CameraMoment> path = interpolated_path(stops, 17);
  REQUIRE(path.size() == 17);
  for (std::size_t i = 0; i < path.size(); ++i) {
    CHECK((turn(path[i]) * turn(path[i]).transpose() - Matrix3d::Identity()).norm() < 1e-12);
    CHECK(turn(path[i]).determinant() == doctest::Approx(1));
    const std::size_t before = i / 4, after = std::min<std::size_t>(before + 1, 4);
    const double share = static_cast<double>(i % 4) / 4;
    CHECK(path[i].time == doctest::Approx((1 - share) * *stops[before].timestamp + share * *stops[after].timestamp));
    const Frame wanted = stop({0, 0, 0}, (1 - share) * degrees[before] + share * degrees[after], 0);
    if (before < 3) CHECK((turn(path[i]) - wanted.world_from_camera.topLeftCorner<3, 3>()).norm() < 1e-9);
    if (i % 4 == 0) CHECK((path[i].world_from_camera - stops[before].world_from_camera).norm() < 1e-12);
  }
}

TEST_CASE("between cameras the path bends with them: on a parabola it stays") {
  std::vector<Frame> stops;
  for (int i = 0; i < 6; ++i) stops.push_back(stop({double(i), 0.3 * i * i, -double(i)}, 0, 0));
  const auto path = interpolated_path(stops, 51);
  for (std::size_t i = 10; i <= 40; ++i) {  // the first and last stretch have a neighbour on one side only
    const double x = 0.1 * static_cast<double>(i);
    CHECK((path[i].world_from_camera.topRightCorner<3, 1>() - Vector3d(x, 0.3 * x * x, -x)).norm() < 1e-12);
  }
}

TEST_CASE("a path does not turn back between cameras that are close together, nor leave those that stand still") {
  const auto uneven = interpolated_path(row({0, 10, 10.1, 10.1, 10.1, 30, 31}), 200);
  for (std::size_t i = 1; i < uneven.size(); ++i) {
    const double x = uneven[i].world_from_camera(0, 3), last = uneven[i - 1].world_from_camera(0, 3);
    CHECK(x >= last - 1e-12);
  }
  for (const CameraMoment& moment : interpolated_path(row({2, 2}), 5)) CHECK(moment.world_from_camera(0, 3) == 2);
}

TEST_CASE("a path of one camera or of one moment") {
  const std::vector<Frame> alone = {stop({1, 2, 3}, 30, 4)};
  const auto still = interpolated_path(alone, 3);
  REQUIRE(still.size() == 3);
  CHECK(still[2].world_from_camera == alone[0].world_from_camera);
  CHECK(still[2].time == 4);
  const auto first = interpolated_path(row({7, 8}), 1);
  REQUIRE(first.size() == 1);
  CHECK(first[0].world_from_camera(0, 3) == 7);
}

TEST_CASE("cameras come by step and name, numbers as numbers, those of other sensors not") {
  Scene photos, log;
  for (const char* name : {"b/r_10.png", "b/r_2.png", "a/r_11.png", "b/r_1.png"}) {
    photos.frames.emplace_back();
    photos.frames.back().image = name;
  }
  CHECK(images(frames_in_order(photos, "")) ==
        std::vector<std::string>{"a/r_11.png", "b/r_1.png", "b/r_2.png", "b/r_10.png"});
  for (const int step : {3, 1, 2}) {
    for (const char* sensor : {"left", "front"}) {
      Frame& frame = log.frames.emplace_back();
      frame.sensor = sensor;
      frame.step = step;
      frame.image = sensor + std::to_string(9 - step);
    }
  }
  CHECK(images(frames_in_order(log, "front")) == std::vector<std::string>{"front8", "front7", "front6"});
}
