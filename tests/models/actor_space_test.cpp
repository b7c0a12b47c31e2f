// Which points lie in actors.
#include "models/scene/actor_space.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "models/io/host_random.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

/// A street of turned boxes of all sizes along the world's y axis.
Scene crowd(int actors, HostRandom& random) {
  const auto between = [&](double low, double high) { return low + (high - low) * double{random.uniform()}; };
  Scene scene;
  for (int i = 0; i < actors; ++i) {
    Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
    pose.topLeftCorner<3, 3>() = Eigen::AngleAxisd(between(0, 6.28), Vector3d::UnitZ()).toRotationMatrix();
    pose.topRightCorner<3, 1>() << between(-15, 15), between(-100, 100), between(0, 2);
    Actor actor;
    actor.size = {between(0.5, 2.5), between(0.5, 12), between(1, 4)};
    actor.boxes = {{0, 1.0, pose}};
    scene.actors.push_back(actor);
  }
  return scene;
}

/// By the box's corners: how far a point is from the middle along each edge. more: metres of room besides.
bool lies_in(const Actor& actor, const Vector3d& point, double more = 0) {
  const Eigen::Matrix4d& pose = actor.boxes.front().world_from_box;
  const Vector3d room = Vector3d(0.2, 0.2, 0.1).array() + more;
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d edge = pose.block<3, 1>(0, axis), middle = pose.block<3, 1>(0, 3);
    if (std::abs((point - middle).dot(edge)) >= actor.size[axis] / 2 + room[axis]) return false;
  }
  return true;
}

}  // namespace

TEST_CASE("the space of actors holds the points that lie in any of their boxes, and no others") {
  HostRandom random(3, 0);
  for (const int actors : {0, 1, 2, 60}) {
    const Scene scene = crowd(actors, random);
    std::vector<bool> without(scene.actors.size(), false);
    for (std::size_t i = 0; i < without.size(); i += 7) without[i] = i > 0;
    const ActorSpace all(scene, 1.0), some(scene, 1.0, without), later(scene, 2.0);
    int inside = 0;
    for (int i = 0; i < 20000; ++i) {
      const auto between = [&](double low, double high) { return low + (high - low) * double{random.uniform()}; };
      const Vector3d point(between(-20, 20), between(-110, 110), between(-3, 5));
      bool in_all = false, in_some = false;
      for (std::size_t a = 0; a < scene.actors.size(); ++a) {
        const bool in = lies_in(scene.actors[a], point);
        in_all |= in;
        in_some |= in && !without[a];
      }
      inside += in_all;
      REQUIRE(all.holds(point) == in_all);
      REQUIRE(some.holds(point) == in_some);
      REQUIRE_FALSE(later.holds(point));
    }
    if (actors == 60) CHECK(inside > 200);
  }
}

TEST_CASE("an actor stands between two points where the way from one to the other leads through its space") {
  constexpr double kStep = 0.02;  // metres
  HostRandom random(4, 0);
  const Scene scene = crowd(20, random);
  const ActorSpace space(scene, 1.0);
  int parted = 0;
  for (int i = 0; i < 600; ++i) {
    const auto between = [&](double low, double high) { return low + (high - low) * double{random.uniform()}; };
    const auto anywhere = [&] { return Vector3d(between(-20, 20), between(-110, 110), between(-2, 5)); };
    const Vector3d a = anywhere(), b = i % 3 == 0 ? Vector3d(a.x(), between(-110, 110), a.z()) : anywhere();
    const auto steps = static_cast<int>(std::ceil((b - a).norm() / kStep));
    const auto meets = [&](double more) {
      return std::any_of(scene.actors.begin(), scene.actors.end(), [&](const Actor& actor) {
        if (lies_in(actor, a) || lies_in(actor, b)) return false;
        for (int step = 1; step < steps; ++step)
          if (lies_in(actor, a + (b - a) * step / steps, more)) return true;
        return false;
      });
    };
    CAPTURE(i);
    if (meets(0)) REQUIRE(space.stands_between(a, b));
    if (!meets(kStep)) REQUIRE_FALSE(space.stands_between(a, b));  // a corner's tip may lie between two steps
    parted += space.stands_between(a, b);
  }
  CHECK(parted > 60);
  CHECK(parted < 540);
  CHECK_FALSE(ActorSpace().stands_between({0, 0, 0}, {9, 9, 9}));
}
