// Ground that an actor hides from cameras, against the shadow that its box casts: a wedge behind it.
#include "models/splat/hidden_ground.h"

#include <doctest/doctest.h>

#include <set>

#include "models/gaussians/initialise.h"
#include "models/street/takes_edits.h"
#include "models/train/trainer.h"
#include "tests/models/made_method.h"
#include "tests/models/toy_street.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

const Camera kWide{100, 50, 50, 50, 50, 25};  // looks at x over 45 degrees to either side
constexpr double kSide = 0.5;                 // metres
constexpr double kEnd = 30;                   // of the ground
/// The side of an actor's space that faces the camera: how far away, half of its width.
struct Face {
  double away, half;
};
constexpr Face kSmaller = {9.2, 0.8}, kLarger = {8.8, 1.2};  // than the box: what it hides for certain, and at all
constexpr float kWrong = 5;

double height_at(double x) { return 0.01 * (x - 10); }
double colour_at(double x, double y) { return 0.05 * x - 0.1 * y; }
/// Seen from (0, 0, 1.5), with so much room at the sides.
bool is_behind(const Face& face, double x, double y, double room) {
  return x > face.away + room && std::abs(y) < face.half / face.away * x - room;
}

/// Points of a sloping plane. Those behind the actor have colours that no photo showed, and there are some, high above
/// and of such a colour, that LiDAR did not see.
StreetStart sloping_ground() {
  PointCloud cloud;
  for (double x = 2.1; x < kEnd; x += kSide)
    for (double y = -15.1; y < 15; y += kSide)
      for (const double value : {x, y, height_at(x)}) cloud.positions.push_back(static_cast<float>(value));
  cloud.colours.assign(cloud.positions.size(), 128);
  StreetStart start;
  start.seen = cloud.count();
  for (double x = 10; x < kEnd; x += kSide)
    for (const double value : {x, x / 20, height_at(x) + 0.25}) cloud.positions.push_back(static_cast<float>(value));
  cloud.colours.assign(cloud.positions.size(), 128);
  start.background = gaussians_from_points(cloud);
  for (size_t i = 0; i < start.background.count(); ++i) {
    const Vector3d at = mean_of(start.background, i);
    const bool wrong = i >= start.seen || is_behind(kLarger, at.x(), at.y(), 0);
    std::fill_n(&start.background.sh_first[3 * i], 3, wrong ? kWrong : static_cast<float>(colour_at(at.x(), at.y())));
  }
  return start;
}

/// Photos of cameras at (0, y, 1.5).
struct Seen {
  std::vector<FramePixels> pixels;
  std::vector<TimedPhoto> photos;
  explicit Seen(const std::vector<double>& places)
      : pixels(places.size(), {0, 0, 100, 50, std::vector<uint8_t>(4 * 100 * 50, 255), {}}) {
    for (size_t i = 0; i < places.size(); ++i) photos.push_back({{pixels[i], kWide, toy_camera_pose(places[i])}, 0.05});
  }
};

Scene behind_an_actor(const std::filesystem::path& root) {
  Scene scene = toy_street(root);
  scene.actors = {toy_actor("1", {2, 2, 3}, 10, 0)};
  return scene;
}

}  // namespace

TEST_CASE("hidden ground lies where an actor's box casts its shadow, as high and of such a colour as beside it") {
  const Folder folder;
  const Scene scene = behind_an_actor(folder.path);
  const Seen seen({0});
  const Gaussians ground = hidden_ground(seen.photos, scene, sloping_ground(), kSide);
  std::set<std::pair<int, int>> cells;
  for (size_t i = 0; i < ground.count(); ++i) {
    const Vector3d at = mean_of(ground, i);
    CAPTURE(at.transpose());
    CHECK(is_behind(kSmaller, at.x(), at.y(), -1e-6));
    cells.emplace(std::lround(std::floor(at.x() / kSide)), std::lround(std::floor(at.y() / kSide)));
    if (at.x() > kEnd) continue;  // beyond all points
    CHECK(std::abs(at.z() - height_at(at.x())) < 0.02);
    for (size_t c = 0; c < 3; ++c)
      CHECK(std::abs(double{ground.sh_first[3 * i + c]} - colour_at(at.x(), at.y())) < 0.5);  // of 5
  }
  CHECK(cells.size() == ground.count());
  for (int x = 18; x < 2 * kEnd; ++x)
    for (int y = -8; y < 8; ++y)
      if (is_behind(kSmaller, (x + 0.5) * kSide, (y + 0.5) * kSide, 0.05)) CHECK(cells.contains({x, y}));
}

TEST_CASE("no ground is hidden that another photo shows, nor without actors") {
  const Folder folder;
  Scene scene = behind_an_actor(folder.path);
  const StreetStart start = sloping_ground();
  Seen seen({0, 12});
  const Gaussians ground = hidden_ground(seen.photos, scene, start, kSide);
  CHECK(ground.count() > 0);
  for (size_t i = 0; i < ground.count(); ++i) {
    const Vector3d at = mean_of(ground, i);
    CAPTURE(at.transpose());
    CHECK(is_behind(kSmaller, at.x(), at.y(), -1e-6));
    CHECK(at.x() < 13);  // from there on, the shadows that both cameras see have parted
  }
  // A photo that is masked shows nothing.
  seen.pixels[1].mask.assign(100 * 50, 0);
  CHECK(hidden_ground(seen.photos, scene, start, kSide).count() > 2 * ground.count());
  // Nor does one in which a low box hides less: over its roof, 0.5 m below the camera, the ground is seen from 3 times
  // the distance of its far side on.
  seen.pixels[1].mask.clear();
  scene.actors = {toy_actor("1", {2, 2, 1}, 10, 0)};
  seen.photos.pop_back();
  const Gaussians low = hidden_ground(seen.photos, scene, start, kSide);
  CHECK(low.count() > 0);
  for (size_t i = 0; i < low.count(); ++i) CHECK(mean_of(low, i).x() < 3 * 11.01);
  scene.actors.clear();
  CHECK(hidden_ground(seen.photos, scene, start, kSide).count() == 0);
}

TEST_CASE("street-gaussians: where an actor was that is taken away lies the ground, from a checkpoint, too") {
  const Folder folder;
  Scene scene = toy_street(folder.path);  // LiDAR sees the foot of the wall, 30 m ahead
  scene.actors = {toy_actor("1", {2, 4, 1.5}, 24, 0)};
  Scenes empty = {scene};
  empty.front().actors.front().boxes.clear();
  const auto made = [&](const char* ground) {
    auto method = configured("street-gaussians", {{"initial.lidar", "300"},
                                                  {"initial.near", "1"},
                                                  {"initial.far", "1"},
                                                  {"initial.actor", "40"},
                                                  {"initial.fewest", "40"},
                                                  {"initial.ground", ground},
                                                  {"sky.side", "4"}});
    method->build({scene}, 3);
    return method;
  };
  const View view = {scene.cameras[0], toy_camera_pose(0), 0, 0.05};
  const auto opacities = [&](Method& method) {
    as<TakesEdits>(method)->take_actors(empty);
    return shown(method, view).opacity;
  };
  const auto method = made("true"), without = made("false");
  for (Method* one : {method.get(), without.get()}) load_data(*one, scene, toy_pixels(scene));
  const std::vector<float> with_ground = opacities(*method), bare = opacities(*without);
  // The pixel of the ground at (26, 0), behind the actor, and one of the wall above it.
  const auto width = static_cast<size_t>(view.camera.width);
  const auto row = static_cast<size_t>(view.camera.cy + view.camera.fy * 1.5 / 26);
  CHECK(with_ground[row * width + width / 2] > 0.9f);
  CHECK(bare[row * width + width / 2] < 0.5f);
  CHECK(with_ground[2 * width + width / 2] == bare[2 * width + width / 2]);

  // LiDAR's ray to that place ends there.
  WorldRays ray;
  ray.time = 0.05;
  ray.origins = {0, 0, 1.5f};
  for (const double part : Vector3d(Vector3d(26, 0, -1.5).normalized()))
    ray.directions.push_back(static_cast<float>(part));
  CHECK(as<Street>(*method)->measure(ray).depths[0] == doctest::Approx(std::hypot(26, 1.5)).epsilon(0.03));

  // Training does not know of it.
  CHECK(loss_of(*method, {4, 10, 3}).item() == loss_of(*without, {4, 10, 3}).item());

  SafetensorsFile saved = checkpoint_of(*method, {}, {});
  const auto restored = made("true");
  restore_method(*restored, saved);
  CHECK(opacities(*restored) == with_ground);
  // A run is what its checkpoint says, also where the data would say more.
  saved.tensors.erase("state.ground.means");
  load_data(*restored, scene, toy_pixels(scene));
  restore_method(*restored, saved);
  CHECK(opacities(*restored) == bare);
  saved.tensors["state.ground.means"] = {"F32", {}, std::vector<std::byte>(4)};
  CHECK_THROWS_WITH_AS(restore_method(*restored, saved), doctest::Contains("ground.means"), Error);
}
