// Turntables: where their cameras stand and look.
#include "models/scene/orbit.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

using namespace cloam;
using Eigen::Vector3d;

namespace {

const Vector3d kSubject(1, 2, 3);

/// Cameras 5 from the axis and 2 above the subject (up is z), at angles between two values, looking at it.
Scene ring(double from, double to, int count) {
  Scene scene;
  for (int i = 0; i < count; ++i) {
    const double angle = from + (to - from) * i / count;
    const Vector3d eye = kSubject + Vector3d(5 * std::cos(angle), 5 * std::sin(angle), 2);
    const Vector3d z = (kSubject - eye).normalized(), x = z.cross(Vector3d::UnitZ()).normalized();
    Frame frame;
    frame.world_from_camera.block<3, 1>(0, 0) = x;
    frame.world_from_camera.block<3, 1>(0, 1) = z.cross(x);
    frame.world_from_camera.block<3, 1>(0, 2) = z;
    frame.world_from_camera.block<3, 1>(0, 3) = eye;
    scene.frames.push_back(frame);
  }
  return scene;
}

Vector3d arm(const Eigen::Matrix4d& pose) { return pose.block<3, 1>(0, 3) - kSubject; }
double angle(const Eigen::Matrix4d& pose) { return std::atan2(arm(pose).y(), arm(pose).x()); }

}  // namespace

TEST_CASE("an orbit keeps the cameras' distance and height and looks at their subject, upright") {
  for (const Eigen::Matrix4d& pose : orbit_poses(ring(0, 2 * std::numbers::pi, 12), 7)) {
    CHECK(arm(pose).z() == doctest::Approx(2).epsilon(1e-4));
    CHECK(arm(pose).head<2>().norm() == doctest::Approx(5).epsilon(1e-4));
    const Eigen::Matrix3d turn = pose.topLeftCorner<3, 3>();
    CHECK(turn.determinant() == doctest::Approx(1));
    CHECK((turn.col(2) + arm(pose).normalized()).norm() < 1e-4);
    CHECK(std::abs(turn(2, 0)) < 1e-6);  // the picture's rows are level
    CHECK(turn(2, 1) < 0);               // its y axis points down
  }
}

TEST_CASE("cameras all around: once around in even steps") {
  const auto poses = orbit_poses(ring(0, 2 * std::numbers::pi, 12), 4);
  for (std::size_t i = 0; i < 4; ++i) {
    CHECK(std::abs(arm(poses[i]).head<2>().dot(arm(poses[(i + 1) % 4]).head<2>())) < 1e-3);
  }
}

TEST_CASE("cameras on one side: the path stays on that side and sweeps it") {
  double least = 10, most = -10;
  for (const Eigen::Matrix4d& pose : orbit_poses(ring(0.5, 1.75, 10), 40)) {  // cameras from 0.5 to 1.625
    least = std::min(least, angle(pose));
    most = std::max(most, angle(pose));
  }
  // Cameras that look down from one side have a mean up that leans a little.
  CHECK(std::abs(least - 0.5) < 0.02);
  CHECK(std::abs(most - 1.625) < 0.02);
}

TEST_CASE("an asset is shown from its front left and a little above") {
  const Camera camera = turntable_camera(80, 80);
  const Eigen::Matrix4d pose = three_quarter_pose({2, 5, 1.5}, camera);
  const Vector3d eye = pose.topRightCorner<3, 1>();
  CHECK(eye.y() > 0);                           // before the front
  CHECK(eye.x() == doctest::Approx(-eye.y()));  // as far to the left
  CHECK(eye.z() > 0.2 * eye.head<2>().norm());  // above it
  CHECK(eye.z() < 0.6 * eye.head<2>().norm());
  CHECK((pose.block<3, 1>(0, 2) + eye.normalized()).norm() < 1e-9);  // it looks at the middle
}

TEST_CASE("a turntable around a box: from the front counter-clockwise, all of the box in view and large in it") {
  const Camera camera = turntable_camera(80, 60);
  const Vector3d size(2, 5, 1.5);
  const auto poses = turntable_poses(size, camera, 4);
  REQUIRE(poses.size() == 4);
  CHECK(poses[0](1, 3) > 2.5);  // before the front, which is +y
  CHECK(poses[1](0, 3) < -1);   // then its left
  for (const Eigen::Matrix4d& pose : poses) {
    CHECK(pose(2, 3) > 0.75);  // above it
    double widest = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const Vector3d at(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
      const Eigen::Vector4d in_camera = pose.inverse() * (0.5 * at.cwiseProduct(size)).homogeneous();
      const Eigen::Vector2d pixel = project(camera, in_camera.head<3>());
      CHECK(in_camera.z() > 0);
      CHECK((pixel.x() > 0 && pixel.x() < 80 && pixel.y() > 0 && pixel.y() < 60));
      widest = std::max(widest, std::abs(pixel.x() - 40));
    }
    CHECK(widest > 8);
  }
}
