// What trains and what is measured, by hand.
#include "models/scene/split.h"

#include <doctest/doctest.h>

#include <algorithm>

#include "runtime/error.h"

using namespace cloam;

namespace {

Scene log_of(int steps, const std::vector<std::string>& sensors) {
  Scene log;
  log.is_log = true;
  for (int step = 0; step < steps; ++step) {
    for (const std::string& sensor : sensors) {
      Frame frame;
      frame.sensor = sensor;
      frame.step = step;
      log.frames.push_back(frame);
    }
    log.sweeps.push_back({"", 0.1 * step, Eigen::Matrix4d::Identity(), step, Split::test});
  }
  return log;
}

std::vector<int> steps_of(const Scene& log, const std::string& sensor, Split split) {
  std::vector<int> steps;
  for (const Frame& frame : log.frames)
    if (frame.sensor == sensor && frame.split == split) steps.push_back(frame.step);
  return steps;
}

std::vector<int> sweeps_of(const Scene& log, Split split) {
  std::vector<int> steps;
  for (const Sweep& sweep : log.sweeps)
    if (sweep.split == split) steps.push_back(sweep.step);
  return steps;
}

}  // namespace

TEST_CASE("sparse trains on front images 0, k, 2k and the last, with their sweeps, and measures the other front ones") {
  Scene log = log_of(13, {"left_camera", "front_camera"});
  apply_protocol(log, {"sparse", 0});
  const std::vector<int> train = {0, 5, 10, 12}, test = {1, 2, 3, 4, 6, 7, 8, 9, 11};
  CHECK(steps_of(log, "front_camera", Split::train) == train);
  CHECK(steps_of(log, "front_camera", Split::test) == test);
  CHECK(steps_of(log, "left_camera", Split::unused).size() == 13);
  CHECK(sweeps_of(log, Split::train) == train);
  CHECK(sweeps_of(log, Split::test) == test);
  apply_protocol(log, {"sparse", 6});
  CHECK(steps_of(log, "front_camera", Split::train) == std::vector<int>{0, 6, 12});
}

TEST_CASE("sparse takes every tenth image of long logs: the paper's 9 of 80, and one more for the last") {
  Scene log = log_of(80, {"front_camera"});
  apply_protocol(log, {"sparse", 0});
  CHECK(steps_of(log, "front_camera", Split::train) == std::vector<int>{0, 10, 20, 30, 40, 50, 60, 70, 79});
  CHECK(steps_of(log, "front_camera", Split::test).size() == 71);
  Scene shorter = log_of(39, {"front_camera"});
  apply_protocol(shorter, {"sparse", 0});
  CHECK(steps_of(shorter, "front_camera", Split::train).size() == 9);  // 0, 5, ... 35, 38
}

TEST_CASE("novel trains on the front camera and measures front left; rotate360 measures no image of the log") {
  Scene log = log_of(4, {"front_camera", "front_left_camera", "back_camera"});
  apply_protocol(log, {"novel", 0});
  CHECK(steps_of(log, "front_camera", Split::train).size() == 4);
  CHECK(steps_of(log, "front_left_camera", Split::test).size() == 4);
  CHECK(steps_of(log, "back_camera", Split::unused).size() == 4);
  CHECK(sweeps_of(log, Split::train).size() == 4);
  apply_protocol(log, {"rotate360", 0});
  CHECK(frames_of(log, Split::train).size() == 4);
  CHECK(frames_of(log, Split::test).empty());
  CHECK(steps_of(log, "front_left_camera", Split::unused).size() == 4);
}

TEST_CASE("the front camera goes by its name, else it is the first listed") {
  CHECK(front_sensor(log_of(1, {"left_camera", "front_camera"})) == "front_camera");
  CHECK(front_sensor(log_of(1, {"image_03", "image_02"})) == "image_02");
  CHECK(front_sensor(log_of(1, {"roof", "mirror"})) == "roof");
}

TEST_CASE("protocols are refused for photos, and by a wrong name") {
  Scene photos = log_of(3, {"front_camera"});
  photos.is_log = false;
  CHECK_THROWS_AS(apply_protocol(photos, {"sparse", 0}), Error);
  Scene log = log_of(3, {"front_camera"});
  CHECK_THROWS_AS(apply_protocol(log, {"dense", 0}), Error);
}
