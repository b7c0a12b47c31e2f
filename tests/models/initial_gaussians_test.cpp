// Where gaussians of a driving log begin: a wall that LiDAR saw, something that drives along it, and the sky.
#include "models/splat/initial_gaussians.h"

#include <doctest/doctest.h>

#include "models/gaussians/initialise.h"
#include "models/splat/initial_street.h"
#include "tests/models/toy_street.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

constexpr double kWidth = 4, kWay = 2;

/// Drives 2 m along the wall, in it: some of it covers the wall at y from -1 to 1 all the time.
Scene with_driver(const Folder& folder) {
  Scene scene = toy_street(folder.path);
  Actor driver = toy_actor("1", {2, kWidth, 3}, kToyWall, 0);
  driver.boxes = {{0, 0, toy_pose(kToyWall, -kWay / 2, 1.5)}, {1, 0.1, toy_pose(kToyWall, kWay / 2, 1.5)}};
  scene.actors = {driver};
  return scene;
}

const Camera kWide{100, 50, 50, 50, 50, 25};  // looks at x over 45 degrees to either side

FramePixels grey_photo(uint8_t grey) {
  FramePixels out{0, 0, 100, 50, std::vector<uint8_t>(4 * 100 * 50, grey), {}};
  for (size_t i = 3; i < out.rgba.size(); i += 4) out.rgba[i] = 255;
  return out;
}

Gaussians grey_gaussians(const std::vector<Vector3d>& means) {
  PointCloud cloud;
  for (const Vector3d& mean : means)
    for (int k = 0; k < 3; ++k) cloud.positions.push_back(static_cast<float>(mean[k]));
  cloud.colours.assign(3 * means.size(), 128);
  return gaussians_from_points(cloud);
}

long grey_of(const Gaussians& g, size_t i) {
  return std::lround(255 * (0.5 + kSphericalFirst * double{g.sh_first[3 * i]}));
}

}  // namespace

TEST_CASE("gaussians of a log begin on what stands still, with some for the sky") {
  const Folder folder;
  const Scene scene = with_driver(folder);
  const InitialGaussians first = initial_gaussians(scene, {"auto", 4000, 1});
  CHECK(first.grey);
  size_t wall = 0, sky = 0;
  for (size_t i = 0; i < first.gaussians.count(); i++) {
    const Eigen::Vector3d mean = mean_of(first.gaussians, i);
    const bool on_wall = std::abs(mean.x() - kToyWall) < 1e-3;
    (on_wall ? wall : sky)++;
    if (on_wall) CHECK_FALSE((std::abs(mean.y()) < (kWidth - kWay) / 2 && mean.z() < 3));
    if (!on_wall) CHECK(mean.norm() > 1.4 * kToyWall);  // the camera stands a metre and a half from the origin
    if (!on_wall) CHECK(mean.z() > -0.1 * mean.norm());
  }
  CHECK(wall == 4000);
  CHECK(sky > 20);
  Scene parked = scene;
  for (ActorBox& box : parked.actors[0].boxes) box.world_from_box = toy_pose(kToyWall, 0, 1.5);
  const Gaussians all = initial_gaussians(parked, {"lidar", 100000, 1}).gaussians;
  size_t inside = 0;
  for (size_t i = 0; i < all.count(); i++) inside += std::abs(mean_of(all, i).y()) < 1 && mean_of(all, i).z() < 3;
  CHECK(inside > 100);  // what is parked belongs to the street
}

TEST_CASE("gaussians take the colours of the photo that shows them from nearest by") {
  FramePixels near = grey_photo(200), far = grey_photo(50);
  near.mask.assign(100 * 50, 255);
  for (size_t y = 0; y < 50; y++)
    for (size_t x = 0; x < 50; x++) near.mask[100 * y + x] = 0;  // its left half tells nothing
  Gaussians g = grey_gaussians({{10, -4, 1.5}, {10, 4, 1.5}, {-10, 0, 1.5}, {0.5, 0, 1.5}});
  Eigen::Matrix4d ahead = toy_camera_pose(0), behind = ahead;
  behind(0, 3) -= 1;
  colour_from({{near, kWide, ahead}, {far, kWide, behind}}, g);
  CHECK(grey_of(g, 0) == 200);  // to the right
  CHECK(grey_of(g, 1) == 50);   // to the left
  CHECK(grey_of(g, 2) == 150);  // behind both: the mean of the others
  CHECK(grey_of(g, 3) == 200);
}

TEST_CASE("a street's gaussians do not take the colours of an actor that stands before them") {
  const Folder folder;
  Scene scene = toy_street(folder.path);
  const Vector3d size(2, 4, 3);
  scene.actors = {toy_actor("near", size, 10, 0), toy_actor("far", size, 20, 0), toy_actor("unseen", size, -10, 0)};
  const FramePixels before = grey_photo(200), beside = grey_photo(50);
  const std::vector<TimedPhoto> photos = {{{before, kWide, toy_camera_pose(0)}, 0.05},
                                          {{beside, kWide, toy_camera_pose(12)}, 0.05}};
  StreetStart start;
  // Behind both actors, which only the camera beside them sees; before them; behind the cameras; under the near one.
  start.background = grey_gaussians({{30, 0, 1.5}, {5, 0, 1.5}, {-10, 0, 1.5}, {10, 0, 0}});
  start.actors = grey_gaussians({{0, 0, 0}, {-30, 0, 0}, {0, 0, 0}, {0, 0, 0}});
  start.owners = {0, 0, 1, 2};
  colour_street(photos, scene, start);
  CHECK(grey_of(start.background, 0) == 50);
  CHECK(grey_of(start.background, 1) == 200);
  CHECK(grey_of(start.background, 2) == 125);
  CHECK(grey_of(start.background, 3) == 125);
  CHECK(grey_of(start.actors, 0) == 200);
  CHECK(grey_of(start.actors, 1) == 200);  // no photo shows it: as the rest of its actor
  CHECK(grey_of(start.actors, 2) == 50);   // the camera before both sees the near one there
  CHECK(grey_of(start.actors, 3) == 150);  // no photo shows its actor: as all the others
}
